// Information of many samples: rows of the regression equation go tile by tile into triangles or Gram matrices. Rows may first be
// filtered along time and decimated, all columns alike: row m is the sum of taps[i] times the columns of sample m factor + i. The samples
// come tile by tile too, and each tile adds its part to all rows that it has a part in.

struct Tiles {
    int groups, stride;                   // of the tile of rows, in registers; columns start on an odd number of them, so that they
                                          // do not all fall into the same sets of the cache
    int inputs = 0, input_stride = 0;     // the same of the tile of samples under a filter
    int64_t beside = 0;                   // zeros on either side of the taps

    explicit Tiles(const Plan& plan) {
        // The widest row's tile takes at most 384 KB, which a second-level cache of 512 KB holds; a multiple of eight rows.
        const int fitting = 49152 / (plan.widest > 0 ? plan.widest : 1) / 8 * 8;
        groups = (fitting > 384 ? 384 : fitting < 32 ? 32 : fitting) / LANES;
        stride = groups | 1;
        if (!plan.taps) return;
        inputs = 256 / LANES;
        input_stride = inputs | 1;
        beside = 4 * (int64_t)plan.factor + LANES;
    }
    size_t rows_size(const Plan& plan, int r) const { return (size_t)plan.row[r].padded * stride; }
    size_t input_size(const Plan& plan, int r) const { return (size_t)plan.row[r].padded * input_stride; }
    size_t taps_size(const Plan& plan) const { return plan.taps ? (size_t)(plan.tap_count + 2 * beside) / LANES + 1 : 0; }

    // Rows from `from` on whose tiles fit the cache together: they are filled together, so that the motion is computed once for them.
    int batch_end(const Plan& plan, int from, size_t* size = nullptr) const {
        size_t used = 0;
        int r = from;
        for (; r < plan.rows; ++r) {
            const size_t more = rows_size(plan, r) + input_size(plan, r);
            if (r > from && used + more > (size_t)98304 / LANES) break;
            used += more;
        }
        if (size) *size = used;
        return r;
    }
};

static size_t workspace(const Tree& t, const Plan* plan) {
    size_t numbers = t.nq + 6 * (size_t)t.nv + 2 * (size_t)t.nv * t.nv;
    numbers += t.nb * (sizeof(Link<Lanes>) / sizeof(Lanes) + 12 + PARAMETERS);
    if (!plan) numbers *= 2;   // of a group and of a single sample
    size_t largest = 0;
    if (plan) {
        const Tiles tiles(*plan);
        for (int r = 0; r < plan->rows;) {
            size_t size;
            r = tiles.batch_end(*plan, r, &size);
            largest = size > largest ? size : largest;
        }
        largest += tiles.taps_size(*plan);
    }
    return (numbers + largest) * sizeof(Lanes) + 192;
}

// Weights of a group of samples in one row; zero where the row is not used, and beyond the last sample.
static inline Lanes row_weight(const Plan& plan, const Arrays& x, int64_t s, int count, int r) {
    Lanes weight = Lanes() + 1.0;
    if (count == LANES && !x.valid && !x.weight) return weight;
    for (int i = 0; i < LANES; ++i) {
        const int64_t at = (s + i) * plan.rows + r;
        weight[i] = i < count && (!x.valid || x.valid[at]) ? (x.weight ? x.weight[at] : 1.0) : 0.0;
    }
    return weight;
}

// Torque, and nothing in the columns beyond. What is not used may hold anything, NaN too: it becomes zero.
static inline void fill_torque(const Plan& plan, const Arrays& x, int64_t s, int count, int r, Lanes weight, Lanes* tile, int stride) {
    const Lanes torque = x.tau ? gather<Lanes>(x.tau, s, plan.rows, r, count) * weight : Lanes();
    tile[(plan.row[r].width - 1) * stride] = weight != 0.0 ? torque : Lanes();
    for (int64_t c = plan.row[r].width; c < plan.row[r].padded; ++c) tile[c * stride] = Lanes();
}

static inline void fill_extras(const Plan& plan, const Arrays& x, int64_t s, int count, int r, Lanes weight, Lanes* tile, int stride) {
    for (int e = 0; e < plan.row[r].extras; ++e) {
        const Extra& extra = plan.row[r].extra[e];
        const Lanes value = plan.dense ? gather<Lanes>(x.extra, s, plan.rows * plan.extras, r * plan.extras + extra.index, count)
                                       : gather<Lanes>(x.extra, s, plan.extras, extra.index, count) * extra.factor;
        const Lanes weighted = value * weight;
        tile[extra.column * stride] = weight != 0.0 ? weighted : Lanes();
    }
}

static inline void move_bodies(const Tree& t, const Arrays& x, int64_t s, int count, Scratch<Lanes>& m) {
    m.load(t, x, s, count);
    pose(t, m.q, m.links);
    motion(t, m.dq, m.ddq, m.links);
}

// Bring samples that come later into the cache while others are worked on.
static inline void fetch(const double* x, int64_t count) {
    for (int64_t i = 0; i < count; i += 8) __builtin_prefetch(x + i);
}
static inline void fetch_samples(const Tree& t, const Plan& plan, const Arrays& x, int64_t s, int64_t count) {
    fetch(x.q + s * t.nq, count * t.nq), fetch(x.dq + s * t.nv, count * t.nv), fetch(x.ddq + s * t.nv, count * t.nv);
    if (!plan.dense) fetch(x.extra + s * plan.extras, count * plan.extras);
}

// Rows from ... end-1 of `count` samples from `first` on.
static void fill_samples(const Tree& t, const Plan& plan, const Arrays& x, const Tiles& tiles, int from, int end, int64_t first, int count, Scratch<Lanes>& m) {
    for (int g = 0; g * LANES < count; ++g) {
        const int64_t s = first + (int64_t)g * LANES;
        const int here = count - g * LANES < LANES ? count - g * LANES : LANES;
        if (from == 0) fetch_samples(t, plan, x, s + tiles.groups * LANES, LANES);
        move_bodies(t, x, s, here, m);
        Lanes* tile = m.tile + g;
        for (int r = from; r < end; tile += tiles.rows_size(plan, r++)) {
            const Lanes weight = row_weight(plan, x, s, here, r);
            fill(t, plan.row[r], m.links, weight, m.twists, tile, tiles.stride);
            fill_extras(plan, x, s, here, r, weight, tile, tiles.stride);
            fill_torque(plan, x, s, here, r, weight, tile, tiles.stride);
        }
    }
}

// Four rows of C columns: the taps, each row's `factor` later than those of the one before, with the columns of some groups of samples.
struct FilterBlocks {
    const double* taps;      // of the first row at the first group
    int factor, used, input_stride, stride, rows;
    const Lanes* input;
    Lanes* tile;
    int at;                  // of the first row in its tile
    template <int C> void run(int c) {
        const auto weight = [this](int i, int g) {
            Lanes taken;
            memcpy(&taken, taps + (int64_t)g * LANES - (int64_t)i * factor, sizeof taken);
            return taken;
        };
        products_of<4, C>(weight, input + c * input_stride, input_stride, used, [&](const double* total) {
            for (int i = 0; i < rows; ++i)
                for (int j = 0; j < C; ++j) tile[(c + j) * stride + (at + i) / LANES][(at + i) % LANES] += total[C * i + j];
        });
    }
};

// The same for filtered rows. taps: with zeros on either side.
static void fill_filtered(const Tree& t, const Plan& plan, const Arrays& x, const Tiles& tiles, const double* taps, int from, int end, int64_t first,
                          int count, Scratch<Lanes>& m) {
    Lanes* inputs = m.tile;
    for (int r = from; r < end; inputs += tiles.rows_size(plan, r++))
        for (int64_t c = 0; c + 1 < plan.row[r].width; ++c)
            for (int g = 0; g * LANES < count; ++g) inputs[c * tiles.stride + g] = Lanes();
    const int64_t factor = plan.factor, limit = (first + count - 1) * factor + plan.tap_count;
    for (int64_t start = first * factor; start < limit; start += (int64_t)tiles.inputs * LANES) {
        const int64_t stop = start + tiles.inputs * LANES < limit ? start + tiles.inputs * LANES : limit;
        for (int g = 0; start + g * LANES < stop; ++g) {
            const int64_t s = start + g * LANES;
            const int here = stop - s < LANES ? (int)(stop - s) : LANES;
            move_bodies(t, x, s, here, m);
            Lanes* input = inputs + g;
            for (int r = from; r < end; input += tiles.input_size(plan, r++)) {
                fill(t, plan.row[r], m.links, Lanes() + 1.0, m.twists, input, tiles.input_stride);
                fill_extras(plan, x, s, here, r, Lanes() + 1.0, input, tiles.input_stride);
            }
        }
        // Rows that these samples have a part in, four at a time, and of the samples those under their taps.
        const int64_t before = start - plan.tap_count + 1;
        int64_t row = before > first * factor ? (before + factor - 1) / factor : first;
        for (; row < first + count && row * factor < stop; row += 4) {
            const int rows = first + count - row < 4 ? (int)(first + count - row) : 4;
            const int64_t low = row * factor > start ? (row * factor - start) / LANES : 0;
            const int64_t over = (row + 3) * factor + plan.tap_count, high = ((over < stop ? over : stop) - start + LANES - 1) / LANES;
            const double* taken = taps + start + low * LANES - row * factor;
            Lanes *tile = m.tile, *input = inputs + low;
            for (int r = from; r < end; input += tiles.input_size(plan, r), tile += tiles.rows_size(plan, r++))
                by_columns(0, (int)plan.row[r].width - 1,
                           FilterBlocks{taken, plan.factor, (int)(high - low), tiles.input_stride, tiles.stride, rows, input, tile, (int)(row - first)});
        }
    }
    Lanes* tile = m.tile;
    for (int r = from; r < end; tile += tiles.rows_size(plan, r++))
        for (int g = 0; g * LANES < count; ++g) {
            const int here = count - g * LANES < LANES ? count - g * LANES : LANES;
            const Lanes weight = row_weight(plan, x, first + g * LANES, here, r);
            for (int64_t c = 0; c + 1 < plan.row[r].width; ++c) tile[c * tiles.stride + g] *= weight;
            fill_torque(plan, x, first + g * LANES, here, r, weight, tile + g, tiles.stride);
        }
}

// The next samples of a call's arrays, all finite? They also come into the cache in one go. Extra columns that are given for each
// row are like torques: only looked at where used.
static bool samples_finite(const Tree& t, const Plan& plan, const Arrays& x, int64_t s, int64_t count) {
    return all_finite(x.q + s * t.nq, count * t.nq) & all_finite(x.dq + s * t.nv, count * t.nv) & all_finite(x.ddq + s * t.nv, count * t.nv) &
           (plan.extras == 0 || plan.dense || all_finite(x.extra + s * plan.extras, count * plan.extras));
}

// Rows lo ... hi-1, tile by tile: use(row, tile, stride, first sample, count). False where a sample is not finite; it stops there.
template <class Use> static bool over_tiles(const Tree& t, const Plan& plan, const Arrays& x, int64_t lo, int64_t hi, char* memory, Use use) {
    Scratch<Lanes> m(t, memory);
    const Tiles tiles(plan);
    double* taps = (double*)m.tile;
    for (int64_t i = 0; plan.taps && i < (int64_t)tiles.taps_size(plan) * LANES; ++i)
        taps[i] = i >= tiles.beside && i < tiles.beside + plan.tap_count ? plan.taps[i - tiles.beside] : 0.0;
    m.tile += tiles.taps_size(plan);
    taps += tiles.beside;
    for (int64_t first = lo; first < hi; first += (int64_t)tiles.groups * LANES) {
        const int count = hi - first < tiles.groups * LANES ? (int)(hi - first) : tiles.groups * LANES;
        const bool finite = plan.taps ? samples_finite(t, plan, x, first * plan.factor, (int64_t)(count - 1) * plan.factor + plan.tap_count)
                                      : samples_finite(t, plan, x, first, count);
        if (!finite) return false;
        for (int from = 0, end; from < plan.rows; from = end) {
            end = tiles.batch_end(plan, from);
            if (plan.taps) fill_filtered(t, plan, x, tiles, taps, from, end, first, count, m);
            else fill_samples(t, plan, x, tiles, from, end, first, count, m);
            Lanes* tile = m.tile;
            for (int r = from; r < end; tile += tiles.rows_size(plan, r++)) use(r, tile, tiles.stride, first, count);
        }
    }
    return true;
}

// Rows lo ... hi-1. Stops with NaN in the first factor where a sample is not finite.
static void information(const Tree& t, const Plan& plan, const Arrays& x, int64_t lo, int64_t hi, char* memory, double* const* factors) {
    const bool finite = over_tiles(t, plan, x, lo, hi, memory, [&](int r, Lanes* tile, int stride, int64_t, int count) {
        const int used = (count + LANES - 1) / LANES;
        const int width = (int)plan.row[r].width, padded = (int)plan.row[r].padded;
        if (plan.split) add_mixed(tile, stride, used, width, padded, (int)plan.split[r], factors[r]);
        else (plan.gram ? add_gram : add_triangle)(tile, stride, used, width, padded, factors[r]);
    });
    if (!finite) factors[0][0] = NAN;
}

// The columns themselves of rows lo ... hi-1, those of one row of the equation after those of the other, without the torque. False where
// a sample or a column is not finite.
static bool row_columns(const Tree& t, const Plan& plan, const Arrays& x, int64_t lo, int64_t hi, char* memory) {
    int64_t across = 0;
    for (int r = 0; r < plan.rows; ++r) across += plan.row[r].width - 1;
    Lanes seen = Lanes();   // stays zero while all is finite
    const bool finite = over_tiles(t, plan, x, lo, hi, memory, [&](int r, Lanes* tile, int stride, int64_t first, int count) {
        double* out = x.out + first * across;
        for (int before = 0; before < r; ++before) out += plan.row[before].width - 1;
        for (int g = 0; g * LANES < count; ++g)
            for (int64_t c = 0; c + 1 < plan.row[r].width; c += LANES) {
                Lanes square[LANES];
                const int64_t wide = plan.row[r].width - 1 - c < LANES ? plan.row[r].width - 1 - c : LANES;
                for (int64_t j = 0; j < LANES; ++j) square[j] = tile[(c + (j < wide ? j : 0)) * stride + g], seen += square[j] * 0.0;
                turn(square);
                const int here = count - g * LANES < LANES ? count - g * LANES : LANES;
                double* into = out + (int64_t)g * LANES * across + c;
                if (wide == LANES) {
                    for (int i = 0; i < here; ++i, into += across) memcpy(into, square + i, sizeof *square);
                } else {
                    for (int i = 0; i < here; ++i, into += across)
                        for (int64_t j = 0; j < wide; ++j) into[j] = square[i][j];
                }
            }
    });
    return finite && !some(~(seen == 0.0));
}

// Add the factors of other samples to `into`: the rows of a triangle are samples like any others.
static void merge(const Plan& plan, char* memory, double* const* into, const double* const* from) {
    Lanes* tile = (Lanes*)aligned(memory);
    const Tiles tiles(plan);
    const int most = tiles.groups * LANES;
    for (int r = 0; r < plan.rows; ++r) {
        const int n = (int)plan.row[r].padded;
        if (plan.gram) {
            for (int e = 0; e < n * n; ++e) into[r][e] += from[r][e];
            continue;
        }
        for (int first = 0; first < n; first += most) {
            const int count = n - first < most ? n - first : most;
            const int used = (count + LANES - 1) / LANES;
            for (int c = 0; c < n; ++c)
                for (int i = 0; i < used * LANES; ++i)
                    tile[c * tiles.stride + i / LANES][i % LANES] = i < count && first + i <= c ? from[r][(first + i) * n + c] : 0.0;
            add_triangle(tile, tiles.stride, used, n, n, into[r]);
        }
    }
}
