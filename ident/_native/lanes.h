// Numbers that are several samples at once (or one), and the few functions on them that the language does not have.
// Included inside the namespace of an instruction set; LANES is its number of doubles in a register.

typedef double Lanes __attribute__((vector_size(8 * LANES)));
typedef long long Bits __attribute__((vector_size(8 * LANES)));

static inline Bits bits(Lanes x) { return (Bits)x; }
static inline Lanes number(Bits x) { return (Lanes)x; }
static inline long long bits(double x) { long long b; memcpy(&b, &x, 8); return b; }
static inline double number(long long x) { double d; memcpy(&d, &x, 8); return d; }

template <class V> struct Width { static constexpr int value = LANES; };
template <> struct Width<double> { static constexpr int value = 1; };

static inline double lane(Lanes x, int i) { return x[i]; }
static inline double lane(double x, int) { return x; }
static inline void set_lane(Lanes& x, int i, double value) { x[i] = value; }
static inline void set_lane(double& x, int, double value) { x = value; }

// Numbers `step` apart in memory.
template <class V> static inline V strided(const double* x, int64_t step);
template <> inline double strided<double>(const double* x, int64_t) { return *x; }
template <> inline Lanes strided<Lanes>(const double* x, int64_t s) {
#if LANES == 8
    return Lanes{x[0], x[s], x[2 * s], x[3 * s], x[4 * s], x[5 * s], x[6 * s], x[7 * s]};
#elif LANES == 4
    return Lanes{x[0], x[s], x[2 * s], x[3 * s]};
#else
    return Lanes{x[0], x[s]};
#endif
}

// Whether any lane of a comparison holds.
static inline bool some(Bits x) {
#if LANES == 8
    typedef long long Half __attribute__((vector_size(32)));
    typedef long long Quarter __attribute__((vector_size(16)));
    const Half h = __builtin_shufflevector(x, x, 0, 1, 2, 3) | __builtin_shufflevector(x, x, 4, 5, 6, 7);
    const Quarter q = __builtin_shufflevector(h, h, 0, 1) | __builtin_shufflevector(h, h, 2, 3);
    return (q[0] | q[1]) != 0;
#elif LANES == 4
    typedef long long Quarter __attribute__((vector_size(16)));
    const Quarter q = __builtin_shufflevector(x, x, 0, 1) | __builtin_shufflevector(x, x, 2, 3);
    return (q[0] | q[1]) != 0;
#else
    return (x[0] | x[1]) != 0;
#endif
}
static inline bool any_beyond(Lanes x, double limit) { return some(~((x <= limit) & (x >= -limit))); }
static inline bool any_beyond(double x, double limit) { return !(std::fabs(x) <= limit); }

// Sine and cosine to about one unit in the last place. The argument is reduced by a multiple of pi/2 split in three parts
// (Cody and Waite), then minimax polynomials on +-pi/4. Angles beyond 1e5 rad, where the split is too short, go to libm.
template <class V> static inline void sine_cosine(V x, V& sine, V& cosine) {
    const double shift = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds, and leaves the integer in the low bits
    const V t = x * 0.63661977236758134308 + shift;
    const V k = t - shift;
    const V r = ((x - k * 1.57079632673412561417e+00) - k * 6.07710050630396597660e-11) - k * 2.02226624879595063154e-21;
    const V z = r * r;
    V s = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08;
    s = s * z + 2.75573137070700676789e-06;
    s = s * z - 1.98412698298579493134e-04;
    s = s * z + 8.33333333332248946124e-03;
    s = s * z - 1.66666666666666324348e-01;
    s = r + r * z * s;
    V c = z * -1.13596475577881948265e-11 + 2.08757232129817482790e-09;
    c = c * z - 2.75573143513906633035e-07;
    c = c * z + 2.48015872894767294178e-05;
    c = c * z - 1.38888888888741095749e-03;
    c = c * z + 4.16666666666666019037e-02;
    c = 1.0 - (0.5 * z - z * z * c);
    const auto n = bits(t);
    const auto odd = (n & 1) != 0;
    sine = number(bits(odd ? c : s) ^ ((n & 2) << 62));
    cosine = number(bits(odd ? s : c) ^ (((n + 1) & 2) << 62));
    if (__builtin_expect(any_beyond(x, 1e5), 0))
        for (int i = 0; i < Width<V>::value; ++i) {
            set_lane(sine, i, std::sin(lane(x, i)));
            set_lane(cosine, i, std::cos(lane(x, i)));
        }
}

// Whether all of `count` numbers are finite: a product with zero is zero but for infinity and NaN.
static inline bool all_finite(const double* x, int64_t count) {
    Lanes sum[4] = {};   // four at a time do not wait for one another
    double rest = 0.0;
    int64_t i = 0;
    for (; i + 4 * LANES <= count; i += 4 * LANES)
        for (int k = 0; k < 4; ++k) {
            Lanes v;
            memcpy(&v, x + i + k * LANES, sizeof v);
            sum[k] += v * 0.0;
        }
    for (; i < count; ++i) rest += x[i] * 0.0;
    sum[0] += sum[1] + sum[2] + sum[3];
    for (int l = 0; l < LANES; ++l) rest += sum[0][l];
    return rest == 0.0;
}

static inline Lanes square_root(Lanes x) {
    for (int i = 0; i < LANES; ++i) x[i] = std::sqrt(x[i]);
    return x;
}
static inline double square_root(double x) { return std::sqrt(x); }

// Sums over the lanes of LANES vectors at once: out[i] is the sum of x[i]. Neighbours are interleaved and added, and the number of
// vectors halves at each step.
static inline void lane_sums(const Lanes* x, double* out) {
#if LANES == 8
    Lanes a[4], b[2];
    for (int i = 0; i < 4; ++i)
        a[i] = __builtin_shufflevector(x[2 * i], x[2 * i + 1], 0, 8, 2, 10, 4, 12, 6, 14) +
               __builtin_shufflevector(x[2 * i], x[2 * i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    for (int i = 0; i < 2; ++i)
        b[i] = __builtin_shufflevector(a[2 * i], a[2 * i + 1], 0, 1, 8, 9, 4, 5, 12, 13) +
               __builtin_shufflevector(a[2 * i], a[2 * i + 1], 2, 3, 10, 11, 6, 7, 14, 15);
    const Lanes s = __builtin_shufflevector(b[0], b[1], 0, 1, 2, 3, 8, 9, 10, 11) +
                    __builtin_shufflevector(b[0], b[1], 4, 5, 6, 7, 12, 13, 14, 15);
#elif LANES == 4
    Lanes a[2];
    for (int i = 0; i < 2; ++i)
        a[i] = __builtin_shufflevector(x[2 * i], x[2 * i + 1], 0, 4, 2, 6) + __builtin_shufflevector(x[2 * i], x[2 * i + 1], 1, 5, 3, 7);
    const Lanes s = __builtin_shufflevector(a[0], a[1], 0, 1, 4, 5) + __builtin_shufflevector(a[0], a[1], 2, 3, 6, 7);
#else
    const Lanes s = __builtin_shufflevector(x[0], x[1], 0, 2) + __builtin_shufflevector(x[0], x[1], 1, 3);
#endif
    for (int i = 0; i < LANES; ++i) out[i] = s[i];
}

// Rows of a square become its columns: at each step blocks beside the diagonal change places, twice as large as before.
static inline void turn(Lanes* x) {
#define EXCHANGE(size, low, high)                                     \
    for (int i = 0; i < LANES; ++i)                                   \
        if (!(i & size)) {                                            \
            const Lanes a = x[i], b = x[i + size];                    \
            x[i] = __builtin_shufflevector(a, b, LIST low);           \
            x[i + size] = __builtin_shufflevector(a, b, LIST high);   \
        }
#define LIST(...) __VA_ARGS__
#if LANES == 8
    EXCHANGE(1, (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15))
    EXCHANGE(2, (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15))
    EXCHANGE(4, (0, 1, 2, 3, 8, 9, 10, 11), (4, 5, 6, 7, 12, 13, 14, 15))
#elif LANES == 4
    EXCHANGE(1, (0, 4, 2, 6), (1, 5, 3, 7))
    EXCHANGE(2, (0, 1, 4, 5), (2, 3, 6, 7))
#else
    EXCHANGE(1, (0, 2), (1, 3))
#endif
#undef LIST
#undef EXCHANGE
}
