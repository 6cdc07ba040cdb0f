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
