// The kernel of any processor, alone, for another machine than this one: reads a case that `cross.py` wrote, works on it, and writes what
// came out and how long it took. Usage: cross CASE RESULT
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "tree.h"

using namespace ident;

namespace {

FILE* in;

template <class T> std::vector<T> read() {   // bytes, then their number of T
    int64_t bytes = 0;
    if (fread(&bytes, 8, 1, in) != 1) exit(2);
    std::vector<T> found((size_t)bytes / sizeof(T));
    if (bytes && fread(found.data(), (size_t)bytes, 1, in) != 1) exit(2);
    return found;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3 || !(in = fopen(argv[1], "rb"))) return 2;
    const auto sizes = read<int64_t>();   // nv, nq, samples, rows, extras, split?
    auto bodies = read<Body>();
    const auto gravity = read<double>();
    const auto table = read<int64_t>();
    const auto steps = read<Step>();
    const auto extras = read<Extra>();
    const auto inertia = read<double>(), q = read<double>(), dq = read<double>(), ddq = read<double>(), tau = read<double>(), extra = read<double>();
    const auto split = read<int64_t>();
    fclose(in);

    Tree tree{(int)bodies.size(), (int)sizes[0], (int)sizes[1], {gravity[0], gravity[1], gravity[2]}, bodies.data()};
    const int64_t n = sizes[2];
    std::vector<Row> rows;
    int64_t step = 0, beside = 0, size = 0;
    Plan plan{};
    plan.rows = (int)sizes[3], plan.extras = (int)sizes[4], plan.factor = 1;
    for (int r = 0; r < plan.rows; ++r) {
        const int64_t* v = table.data() + 4 * r;
        rows.push_back({v[0], v[1], v[2], v[3], steps.data() + step, extras.data() + beside});
        step += v[0], beside += v[1], size += v[3] * v[3];
        plan.widest = v[3] > plan.widest ? (int)v[3] : plan.widest;
    }
    plan.row = rows.data();

    FILE* out = fopen(argv[2], "wb");
    if (!out) return 2;
    const auto write = [&](const std::vector<double>& values) { fwrite(values.data(), 8, values.size(), out); };
    std::vector<char> memory(kernel_baseline.workspace(tree, &plan) + kernel_baseline.workspace(tree, nullptr));
    Arrays x{};
    x.inertia = inertia.data(), x.q = q.data(), x.dq = dq.data(), x.ddq = ddq.data(), x.tau = tau.data(), x.extra = extra.data();
    for (int form = 0; form < 3; ++form) {   // triangle, Gram, products of the instruments alone
        plan.gram = form > 0, plan.split = form == 2 ? split.data() : nullptr;
        std::vector<double> factors((size_t)size);
        std::vector<double*> places;
        double* at = factors.data();
        for (const Row& row : rows) places.push_back(at), at += row.padded * row.padded;
        const auto start = std::chrono::steady_clock::now();
        kernel_baseline.information(tree, plan, x, 0, n, memory.data(), places.data());
        const std::chrono::duration<double, std::micro> took = std::chrono::steady_clock::now() - start;
        fprintf(stderr, "%s %.3f us a sample\n", form == 0 ? "triangle" : form == 1 ? "gram" : "mixed", took.count() / (double)n);
        write(factors);
    }
    std::vector<double> torque((size_t)n * tree.nv);
    x.out = torque.data();
    kernel_baseline.task[INVERSE](tree, nullptr, x, 0, n, memory.data());
    write(torque);
    x.ddq = nullptr, x.tau = torque.data();
    std::vector<double> made((size_t)n * tree.nv);
    x.out = made.data();
    if (kernel_baseline.task[FORWARD](tree, nullptr, x, 0, n, memory.data()) >= 0) return 3;
    write(made);
    fclose(out);
    return 0;
}
