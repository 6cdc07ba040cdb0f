// Rows of the regression equation, and what least squares needs from them. A tile holds one row of some hundred samples:
// column after column, `stride` Lanes apart; it stays in the cache and is reduced to a triangle or a Gram matrix.

// Columns of one body for the unit twist s (linear s[0..2], angular s[3..5]): its power against the wrench of unit parameters.
template <class V> static inline void columns(const Link<V>& k, const V* s, V* tile, int64_t stride, const int64_t* at) {
    const V* B = k.B;
    const V x = s[3], y = s[4], z = s[5];
    tile[at[0] * stride] = s[0] * k.b[0] + s[1] * k.b[1] + s[2] * k.b[2];
    tile[at[1] * stride] = B[0] * s[0] + B[3] * s[1] + B[6] * s[2] + k.b[1] * z - k.b[2] * y;
    tile[at[2] * stride] = B[1] * s[0] + B[4] * s[1] + B[7] * s[2] + k.b[2] * x - k.b[0] * z;
    tile[at[3] * stride] = B[2] * s[0] + B[5] * s[1] + B[8] * s[2] + k.b[0] * y - k.b[1] * x;
    tile[at[4] * stride] = k.a[0] * x + k.P[1] * y - k.P[2] * z;
    tile[at[5] * stride] = B[7] * y + k.D[2] * z - B[6] * x;
    tile[at[6] * stride] = k.a[1] * y + k.P[2] * z - k.P[0] * x;
    tile[at[7] * stride] = B[3] * x + k.D[1] * y - B[5] * z;
    tile[at[8] * stride] = k.D[0] * x + B[2] * z - B[1] * y;
    tile[at[9] * stride] = k.a[2] * z + k.P[0] * x - k.P[1] * y;
}

// The same for an angular velocity f about z' alone; columns that are always zero go to the spare column, if anywhere.
template <class V> static inline void own_columns(const Link<V>& k, V f, V* tile, int64_t stride, const int64_t* at) {
    const V zero = V();
    tile[at[0] * stride] = zero;
    tile[at[3] * stride] = zero;
    tile[at[1] * stride] = k.b[1] * f;
    tile[at[2] * stride] = -(k.b[0] * f);
    tile[at[4] * stride] = -(k.P[2] * f);
    tile[at[5] * stride] = k.D[2] * f;
    tile[at[6] * stride] = k.P[2] * f;
    tile[at[7] * stride] = -(k.B[5] * f);
    tile[at[8] * stride] = k.B[2] * f;
    tile[at[9] * stride] = k.a[2] * f;
}

// One row over all its bodies, into tile columns `stride` apart. `weight` scales it; twists: 6 nb of scratch.
template <class V> static inline void fill(const Tree& t, const Row& row, const Link<V>* links, V weight, V* twists, V* tile, int64_t stride) {
    for (int e = 0; e < row.steps; ++e) {
        const Step& step = row.step[e];
        const Body& body = t.bodies[step.body];
        const Link<V>& k = links[step.body];
        V* s = twists + 6 * step.body;
        if (step.starts) {
            for (int c = 0; c < 6; ++c) s[c] = weight * step.twist[c];
            if (step.own) {
                own_columns(k, s[5], tile, stride, step.column);
                continue;
            }
        } else {
            const V* up = twists + 6 * body.parent;
            const Vec<V> angular{{up[3], up[4], up[5]}};
            const Vec<V> linear = into(body, k, Vec<V>{{up[0], up[1], up[2]}} + cross(angular, k.p));
            const Vec<V> turned = into(body, k, angular);
            for (int c = 0; c < 3; ++c) s[c] = linear[c], s[3 + c] = turned[c];
            if (step.joins)
                for (int c = 0; c < 6; ++c) s[c] += weight * step.twist[c];
        }
        columns(k, s, tile, stride, step.column);
    }
}

// Gram matrix (upper triangle, padded x padded) of a tile, added to G. Blocks of ROWS x 4 sums stay in registers.
constexpr int ROWS = LANES == 8 ? 4 : 2;

static void add_gram(const Lanes* tile, int stride, int used, int padded, double* G) {
    for (int r = 0; r < padded; r += ROWS)
        for (int c = r / 4 * 4; c < padded; c += 4) {
            Lanes sum[ROWS * 4] = {};
            const Lanes* a = tile + r * stride;
            const Lanes* b = tile + c * stride;
            for (int g = 0; g < used; ++g)
                for (int i = 0; i < ROWS; ++i)
                    for (int j = 0; j < 4; ++j) sum[4 * i + j] += a[i * stride + g] * b[j * stride + g];
            double total[ROWS * 4];
            sums<ROWS * 4>(sum, total);
            for (int i = 0; i < ROWS; ++i)
                for (int j = 0; j < 4; ++j) G[(r + i) * padded + c + j] += total[4 * i + j];
        }
}

// Householder triangularisation of [R; tile], R upper triangular (padded x padded), by panels of four columns in compact WY form
// (Schreiber and Van Loan 1989). The part of a reflector in R is a unit vector, so only its part in the tile is stored, over the
// columns it annihilates.
constexpr int PANEL = 4;
constexpr int BESIDE = LANES == 8 ? 4 : 2;   // trailing columns handled together

static void add_triangle(Lanes* tile, int stride, int used, int padded, double* R) {
    for (int first = 0; first < padded; first += PANEL) {
        Lanes* panel = tile + first * stride;
        double T[PANEL][PANEL] = {};
        bool any = false;
        for (int j = 0; j < PANEL; ++j) {
            // x = column j; its products with the panel's reflectors (before j) and with its columns (from j on), in one pass.
            Lanes* x = panel + j * stride;
            double* Rj = R + (first + j) * padded + first;
            Lanes sum[PANEL > LANES ? PANEL : LANES] = {};
            double dot[PANEL > LANES ? PANEL : LANES];
            for (int g = 0; g < used; ++g)
                for (int c = 0; c < PANEL; ++c) sum[c] += x[g] * panel[c * stride + g];
            sums<(PANEL > LANES ? PANEL : LANES)>(sum, dot);
            if (!(dot[j] > 0.0)) continue;   // nothing to annihilate: tau = 0, and the column is zero
            any = true;
            const double norm = std::sqrt(Rj[j] * Rj[j] + dot[j]);
            const double beta = Rj[j] > 0.0 ? -norm : norm;
            const double tau = (beta - Rj[j]) / beta, scale = 1.0 / (Rj[j] - beta);
            Rj[j] = beta;
            double factor[PANEL] = {};
            for (int c = j + 1; c < PANEL; ++c) {
                const double w = tau * (Rj[c] + scale * dot[c]);
                Rj[c] -= w;
                factor[c] = w * scale;
            }
            for (int g = 0; g < used; ++g) {
                const Lanes v = x[g];
                for (int c = j + 1; c < PANEL; ++c) panel[c * stride + g] -= factor[c] * v;
                x[g] = v * scale;
            }
            T[j][j] = tau;
            for (int i = 0; i < j; ++i)
                for (int e = i; e < j; ++e) T[i][j] -= tau * scale * T[i][e] * dot[e];
        }
        if (!any) continue;
        double* Rp = R + first * padded;
        for (int c = first + PANEL; c < padded; c += BESIDE) {
            Lanes* a = tile + c * stride;
            Lanes sum[PANEL * BESIDE] = {};
            for (int g = 0; g < used; ++g)
                for (int i = 0; i < PANEL; ++i)
                    for (int j = 0; j < BESIDE; ++j) sum[i * BESIDE + j] += panel[i * stride + g] * a[j * stride + g];
            double w[PANEL * BESIDE], z[PANEL * BESIDE];
            sums<PANEL * BESIDE>(sum, w);
            for (int i = 0; i < PANEL; ++i)
                for (int j = 0; j < BESIDE; ++j) w[i * BESIDE + j] += Rp[i * padded + c + j];
            for (int i = 0; i < PANEL; ++i)   // z = T' w
                for (int j = 0; j < BESIDE; ++j) {
                    double value = 0.0;
                    for (int e = 0; e <= i; ++e) value += T[e][i] * w[e * BESIDE + j];
                    z[i * BESIDE + j] = value;
                    Rp[i * padded + c + j] -= value;
                }
            for (int g = 0; g < used; ++g)
                for (int j = 0; j < BESIDE; ++j) {
                    Lanes value = a[j * stride + g];
                    for (int i = 0; i < PANEL; ++i) value -= z[i * BESIDE + j] * panel[i * stride + g];
                    a[j * stride + g] = value;
                }
        }
    }
}
