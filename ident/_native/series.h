// Filters along time over many signals at once, for the colour of noise. Included inside the namespace of an instruction set.
// Samples are rows of `width` numbers, a multiple of 8: all columns of a row go through the same filter.

// As many registers of a row as fit, C at a time.
template <template <int> class Work, class... Given> static void by_registers(int64_t width, Given... given) {
    int64_t c = 0;
    for (; c + 4 * LANES <= width; c += 4 * LANES) Work<4>::run(c, width, given...);
    for (; c < width; c += LANES) Work<1>::run(c, width, given...);
}

static inline Lanes at(const double* x) {
    Lanes out;
    memcpy(&out, x, sizeof out);
    return out;
}

// y[t] = a[0] x[t] + ... + a[order] x[t - order]; `x` has `order` rows before the first of `count`. `a` is padded: 3 zeros on either side.
template <int C> struct Average {
    static void run(int64_t c, int64_t width, const double* a, int order, const double* x, int64_t count, double* y) {
        constexpr int V = C > 1 ? 2 : 1;   // registers side by side: with four rows at a time, eight sums
        for (int v = 0; v < C; v += V)
            for (int64_t t = 0; t < count; t += 4) {
                Lanes sum[4][V] = {};
                const int rows = count - t < 4 ? (int)(count - t) : 4;
                const double* from = x + (t - order) * width + c + v * LANES;
                for (int u = 0; u < order + rows; ++u, from += width) {
                    const double* weight = a + order - u;   // of row i: a[order + i - u]
                    Lanes value[V];
                    for (int i = 0; i < V; ++i) value[i] = at(from + i * LANES);
                    for (int i = 0; i < 4; ++i)
                        for (int k = 0; k < V; ++k) sum[i][k] += weight[i] * value[k];
                }
                for (int i = 0; i < rows; ++i)
                    for (int k = 0; k < V; ++k) memcpy(y + (t + i) * width + c + (v + k) * LANES, &sum[i][k], sizeof(Lanes));
            }
    }
};

static void average(const double* a, int order, const double* x, int64_t width, int64_t count, double* y) {
    by_registers<Average>(width, a, order, x + order * width, count, y);
}

// y[t] = x[t] - a[1] y[t - 1] - ... - a[order] y[t - order]; `y` has `order` rows before the first.
template <int C> struct Recursion {
    static void run(int64_t c, int64_t width, const double* a, int order, const double* x, int64_t count, double* y) {
        for (int64_t t = 0; t < count; ++t) {
            Lanes even[C], odd[C] = {};
            for (int i = 0; i < C; ++i) even[i] = at(x + t * width + c + i * LANES);
            const double* before = y + (t - order) * width + c;
            int k = order;
            for (; k >= 2; k -= 2, before += 2 * width)
                for (int i = 0; i < C; ++i) {
                    odd[i] += a[k] * at(before + i * LANES);
                    even[i] -= a[k - 1] * at(before + width + i * LANES);
                }
            for (int i = 0; i < C; ++i) {
                const Lanes sum = even[i] - odd[i] - (k == 1 ? a[1] * at(before + i * LANES) : Lanes{});
                memcpy(y + t * width + c + i * LANES, &sum, sizeof sum);
            }
        }
    }
};

static void recursion(const double* a, int order, const double* x, int64_t width, int64_t count, double* y) {
    by_registers<Recursion>(width, a, order, x, count, y + order * width);
}

// Sums over `count` rows y of the products of R of their numbers, from r on, with C registers of them, from c on; added to G (width x width).
template <int R, int C> static inline void outer(const double* y, int64_t width, int64_t count, int64_t r, int64_t c, double* G) {
    Lanes sum[R][C] = {};
    for (int64_t t = 0; t < count; ++t, y += width) {
        Lanes value[C];
        for (int k = 0; k < C; ++k) value[k] = at(y + c + k * LANES);
        for (int i = 0; i < R; ++i)
            for (int k = 0; k < C; ++k) sum[i][k] += y[r + i] * value[k];
    }
    for (int i = 0; i < R; ++i)
        for (int k = 0; k < C; ++k) {
            double* into = G + (r + i) * width + c + k * LANES;
            const Lanes total = at(into) + sum[i][k];
            memcpy(into, &total, sizeof total);
        }
}

// Products of the first `rows` numbers of each row with each number from there on: the upper triangle of G, and some of what is below it.
static void row_products(const double* y, int64_t width, int64_t count, int64_t rows, double* G) {
    constexpr int R = LANES == 4 ? 4 : 8;   // with two registers beside each other, as many sums as there are registers for
    for (int64_t r = 0; r < rows; r += R) {
        int64_t c = r / LANES * LANES;
        for (; c + 2 * LANES <= width; c += 2 * LANES) outer<R, 2>(y, width, count, r, c, G);
        for (; c < width; c += LANES) outer<R, 1>(y, width, count, r, c, G);
    }
}

static int64_t whitening_rows(const Whitening& w) {
    const int64_t fitting = 24576 / (w.width ? w.width : 1) / 8 * 8;   // rows before and after it take 384 KB
    return fitting > 256 ? 256 : fitting < 32 ? 32 : fitting;
}

static size_t whitening_memory(const Whitening& w) { return (size_t)((w.order + 2 * whitening_rows(w)) * w.width) * sizeof(double) + 64; }

// Returns the rows since the last gap, at most `order`. `memory`: whitening_memory.
static int64_t whiten(const Whitening& w, int64_t count, int64_t age, char* memory) {
    const int64_t most = whitening_rows(w), width = w.width, order = w.order, pitch = order + 7;
    double* line = (double*)aligned(memory);
    double* own = line + (order + most) * width;
    if (order) memcpy(line, w.past, (size_t)(order * width) * sizeof(double));
    for (int64_t first = 0; first < count; first += most) {
        const int64_t m = count - first < most ? count - first : most;
        double *x = line + order * width, *y = w.out ? w.out + first * width : own;
        const auto used = [&](int64_t t) { return !w.valid || w.valid[(first + t) * w.valid_stride]; };
        for (int64_t t = 0; t < m; ++t) {
            double* into = x + t * width;
            int64_t c = 0;
            for (int i = 0; used(t) && i < w.parts; c += w.part[i].count, ++i)
                memcpy(into + c, w.part[i].from + (first + t) * w.part[i].stride, (size_t)w.part[i].count * sizeof(double));
            memset(into + c, 0, (size_t)(width - c) * sizeof(double));
        }
        for (int64_t t = 0; t < m;) {
            double* into = y + t * width;
            if (!used(t)) {
                memset(into, 0, (size_t)width * sizeof(double));
                age = 0, ++t;
            } else if (age < order) {   // as many rows before as there are
                average(w.predictors + age * pitch + 3, (int)age, x + (t - age) * width, width, 1, into);
                ++age, ++t;
            } else {
                int64_t end = t + 1;
                while (end < m && used(end)) ++end;
                average(w.predictors + order * pitch + 3, (int)order, x + (t - order) * width, width, end - t, into);
                t = end;
            }
        }
        if (w.products) row_products(y, width, m, w.rows, w.products);
        memmove(line, line + m * width, (size_t)(order * width) * sizeof(double));
    }
    if (order) memcpy(w.past, line, (size_t)(order * width) * sizeof(double));
    return age;
}

// One step of Burg's lattice over stretches of samples: errors forwards (A, by the last sample they are of) and backwards (B, by the first),
// `shift` apart, take up `reflection`; sums[0], sums[1]: squares of both, and their product, for the next step, which is one further apart.
static void lattice(double* A, double* B, const int64_t* stretches, int64_t count, int64_t shift, double reflection, double* sums) {
    constexpr int64_t BLOCK = 1024;   // stays in the first-level cache from one loop to the next
    Lanes squares[2] = {}, products[2] = {};
    double square = 0.0, product = 0.0;
    for (int64_t c = 0; c < count; ++c) {
        const int64_t begin = stretches[2 * c], end = stretches[2 * c + 1] - shift;
        for (int64_t first = begin, done = begin; first < end; first += BLOCK) {
            const int64_t last = end - first < BLOCK ? end : first + BLOCK;
            int64_t j = first;
            for (; j + LANES <= last; j += LANES) {
                const Lanes a = at(A + j + shift), b = at(B + j), ahead = a + reflection * b, behind = b + reflection * a;
                memcpy(A + j + shift, &ahead, sizeof ahead), memcpy(B + j, &behind, sizeof behind);
            }
            for (; j < last; ++j) {
                const double a = A[j + shift], b = B[j];
                A[j + shift] = a + reflection * b, B[j] = b + reflection * a;
            }
            const double* next = A + shift + 1;
            for (j = done; j + 2 * LANES <= last - 1; j += 2 * LANES)
                for (int i = 0; i < 2; ++i) {
                    const Lanes a = at(next + j + i * LANES), b = at(B + j + i * LANES);
                    squares[i] += a * a + b * b, products[i] += a * b;
                }
            for (; j < last - 1; ++j) square += next[j] * next[j] + B[j] * B[j], product += next[j] * B[j];
            done = j;
        }
    }
    for (int l = 0; l < LANES; ++l) square += squares[0][l] + squares[1][l], product += products[0][l] + products[1][l];
    sums[0] = square, sums[1] = product;
}
