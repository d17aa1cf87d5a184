// snippet block
// Numbers of a block of pixels, as many as `like` has: in a processor's registers, and a thread's
// own one on a GPU.
#ifdef __CUDA_ARCH__
typedef float Block;
typedef float Stored;
typedef int Places;
auto numbers = [](int first) { return (float)first; };
auto take = [](const float* from, int place) { return from[place]; };
auto every_second = [](const float* from) { return *from; };
auto whole = [](Block x) { return (int)x; };
auto real = [](Places x) { return (float)x; };
auto power = [](Block x) { return expf(x); };
auto keep = [](unsigned char* to, Block levels) { *to = (unsigned char)levels; };
auto root = [](Block x) { return sqrtf(x); };
auto most = [](Block x, Block y) { return fmaxf(x, y); };
auto least = [](Block x, Block y) { return fminf(x, y); };
auto largest = [](Block x) { return x; };
auto first_over = [](Block) { return 0; };
auto last_over = [](Block) { return 0; };
#else
typedef float Block __attribute__((vector_size(sizeof(like))));
typedef float Stored __attribute__((vector_size(sizeof(like)), aligned(4)));
typedef int Places __attribute__((vector_size(sizeof(like))));
auto whole = [](Block x) { return __builtin_convertvector(x, Places); };
auto real = [](Places x) { return __builtin_convertvector(x, Block); };
typedef unsigned char Bytes __attribute__((vector_size(sizeof(like) / sizeof(float)), aligned(1)));
auto keep = [](unsigned char* to, Block x) { *(Bytes*)to = __builtin_convertvector(x, Bytes); };
auto power = [](Block x) {
    for (int n = 0; n < (int)(sizeof(Block) / sizeof(float)); ++n) x[n] = wp::exp(x[n]);
    return x;
};
auto numbers = [](int first) {
    Block values;
    for (int n = 0; n < (int)(sizeof(Block) / sizeof(float)); ++n) values[n] = first + n;
    return values;
};
auto every_second = [](const float* from) {
    Block values;
    for (int n = 0; n < (int)(sizeof(Block) / sizeof(float)); ++n) values[n] = from[2 * n];
    return values;
};
auto take = [](const float* from, Places place) {
    Block values;
    for (int n = 0; n < (int)(sizeof(Block) / sizeof(float)); ++n) values[n] = from[place[n]];
    return values;
};
auto root = [](Block x) -> Block { return __builtin_elementwise_sqrt(x); };
auto most = [](Block x, Block y) -> Block { return __builtin_elementwise_max(x, y); };
auto least = [](Block x, Block y) -> Block { return __builtin_elementwise_min(x, y); };
auto largest = [](Block x) { return __builtin_reduce_max(x); };
auto first_over = [](Block x) {
    int n = 0;
    while (!(x[n] > 0.0f) && n < (int)(sizeof(Block) / sizeof(float)) - 1) ++n;
    return n;
};
auto last_over = [](Block x) {
    int n = (int)(sizeof(Block) / sizeof(float)) - 1;
    while (!(x[n] > 0.0f) && n > 0) --n;
    return n;
};
#endif
const int lanes = sizeof(Block) / sizeof(float);
const Block none = {};
auto load = [](const float* from) -> Block { return *(const Stored*)from; };
auto store = [](float* to, Block values) { *(Stored*)to = values; };

// snippet neighbours
// include block
// Samples right of a block of samples in column c of its pixels, less those left of it; and below
// a block in row a, less above.
const int samples = layout.samples, plane = lanes * layout.plane;
auto along_row = [=](const float* at, int c) -> Block {
    const int wrap = (samples - 1) * plane - 1;
    return load(at + (c == samples - 1 ? -wrap : plane)) - load(at + (c == 0 ? wrap : -plane));
};
auto down_column = [=](const float* at, int a) -> Block {
    const int step = samples * plane, wrap = (samples - 1) * step - lanes * layout.pitch;
    return load(at + (a == samples - 1 ? -wrap : step)) - load(at + (a == 0 ? wrap : -step));
};

// snippet blocks
const int channel = lanes * layout.rows * layout.blocks;  // between a plane's colours
for (int k = part * layout.span; k < (part + 1) * layout.span; ++k) {
    const int place = first_place + k, pixel = row * layout.blocks + k;

// snippet lay_out
// include block
// include blocks
    const int samples = layout.samples, plane = lanes * layout.plane;
    const Places order = whole(least(numbers(0), none + (float)(layout.columns - 1 - k * lanes)));
    const bool is_full = (k + 1) * lanes <= layout.columns;
    for (int s = 0; s < samples * samples; ++s) {
        const int row_at = (image * layout.rows + row) * samples + s / samples;
        const int first = (row_at * layout.columns + k * lanes) * samples + s % samples;
        const float* from = dent.data + first;
        const bool is_double = is_full && samples == 2;
        const Block values = is_double ? every_second(from) : take(from, order * samples);
        const int at = lanes * place + s * plane;
        const int at_rest = lanes * ((row + 1) * layout.pitch + 1 + k) + s * plane;
        store((float*)dent_out.data + at, values);
        store((float*)height_out.data + at, load((const float*)rest.data + at_rest) - values);
    }
}

// snippet tilt
// include neighbours
// include blocks
    for (int s = 0; s < samples * samples; ++s) {
        const int at = lanes * place + s * plane;
        const float* from = (const float*)height.data + at;
        const Block p = along_row(from, s % samples) * layout.half_per_x;
        const Block q = down_column(from, s / samples) * layout.half_per_y;
        const Block scale = 1.0f / root(1.0f + p * p + q * q);
        store((float*)along_out.data + at, p * scale);
        store((float*)across_out.data + at, q * scale);
    }
}

// snippet colour
// include neighbours
// include blocks
    const float *along_at = (const float*)along.data + lanes * place;
    const float *across_at = (const float*)across.data + lanes * place;
    const float *dent_at = (const float*)dent.data + lanes * place;
    const int count = samples * samples;
    auto bend_at = [=](int s) -> Block {
        return along_row(along_at + s * plane, s % samples) * layout.half_per_x
            + down_column(across_at + s * plane, s / samples) * layout.half_per_y;
    };
    Block p = none, q = none, w = none, bend = none, apart = none;
    for (int s = 0; s < count; ++s) {
        p += load(along_at + s * plane);
        q += load(across_at + s * plane);
        w += load(dent_at + s * plane);
        bend += bend_at(s);
    }
    const float share = 1.0f / count;
    p *= share, q *= share, w *= share, bend *= share;
    for (int s = 0; s < count; ++s) {
        const Block p_off = load(along_at + s * plane) - p, q_off = load(across_at + s * plane) - q;
        apart = most(apart, most(most(p_off, -p_off), most(q_off, -q_off)));
    }
    const int times = largest(apart) > LEVEL_TILT ? count : 1;
    const Block u = load((const float*)columns.data + lanes * k);
    Block red = none, green = none, blue = none;
    for (int s = 0; s < times; ++s) {
        if (times > 1) {
            p = load(along_at + s * plane), q = load(across_at + s * plane);
            w = load(dent_at + s * plane), bend = bend_at(s);
        }
        const Block size = p * p + q * q, upright = root(most(1.0f - size, none));
        const Block bound = model.tilt_limit / most(root(size), none + model.tilt_limit);
        const Block x = p * bound, y = q * bound;
        const Block depth = least(w, none + model.depth_limit) * (1.0f / INDENTATION_UNIT_M);
        // Monomials from one to the next, and powers of the place along the row by Horner's rule
        const float* weight = model.weights.data + row * model.weight_count;
        const int* degree = model.degrees.data;
        Block reds = none, greens = none, blues = none;
        for (int c = 0; c < model.along_powers; ++c) {
            reds *= u, greens *= u, blues *= u;
            Block power = none + 1.0f;
            for (int e = 0; e < model.depth_powers; ++e, ++degree) {
                Block column = power;
                for (int b = *degree; b >= 0; --b) {
                    Block term = column;
                    for (int a = b; a >= 0; --a, weight += 3) {
                        reds += weight[0] * term;
                        greens += weight[1] * term;
                        blues += weight[2] * term;
                        term *= x;
                    }
                    column *= y;
                }
                power *= depth;
            }
        }
        red += reds, green += greens, blue += blues;
        // Light of near lamps less that on level gel, see `shading_terms`; creases come last
        weight = model.lamp_weights.data + 6 * row * (model.lamp_count + 1);
        const float* lamp = (const float*)lamps.data + lanes * pixel;
        for (int m = 0; m <= model.lamp_count; ++m, weight += 6, lamp += 4 * channel) {
            Block value;
            if (m < model.lamp_count) {
                value = p * load(lamp) + q * load(lamp + channel);
                value += upright * load(lamp + 2 * channel);
                value = 0.5f * (value + root(value * value + model.bend));
                value -= load(lamp + 3 * channel);
            } else {
                value = most(least(bend, none + model.crease_limit), none - model.crease_limit);
                value *= CREASE_UNIT_M;
            }
            const Block shifted = value * u;
            red += weight[0] * value + weight[1] * shifted;
            green += weight[2] * value + weight[3] * shifted;
            blue += weight[4] * value + weight[5] * shifted;
        }
    }
    const float* gain_at = (const float*)gain.data + lanes * pixel;
    float* change = (float*)change_out.data + lanes * (image * layout.rows * layout.blocks + pixel);
    const float each = 1.0f / times;
    store(change, red * each * load(gain_at));
    change += lanes * change_out.shape[1];
    store(change, green * each * load(gain_at + channel));
    change += lanes * change_out.shape[1];
    store(change, blue * each * load(gain_at + 2 * channel));
}

// snippet measure
// include block
// A processor's cells are as many samples long and high as a block is wide.
const int rows = dent.shape[1], columns = dent.shape[2], last = columns - lanes - 1;
const int left = lanes * j < last ? lanes * j : last;
const int bottom = lanes * (i + 1) < rows ? lanes * (i + 1) : rows;
const bool is_border = i == 0 || j == 0 || bottom == rows || lanes * (j + 1) >= columns;
Block steepest = none, highest = none;
for (int row = lanes * i; row < bottom && left >= 0; ++row) {
    const float* at = dent.data + (image * rows + row) * columns + left;
    const Block here = load(at), right = load(at + 1);
    const Block below = row + 1 < rows ? load(at + columns) : here;
    steepest = most(steepest, most(here - right, right - here));
    steepest = most(steepest, most(here - below, below - here));
    highest = most(highest, most(here, right));
}
if (is_border) steepest = most(steepest, highest);
const int cell = (image * cells_out.shape[1] + i) * cells_out.shape[2] + j;
float* to = (float*)(cells_out.data + cell);
to[0] = left < 0 ? 1.0f : largest(steepest);
to[1] = left < 0 ? 1.0f : largest(highest);

// snippet follow
// include block
const int steps = rays.starts.shape[0], stride = lanes * rays.pitch, last = rays.across - 1;
const float *far = rays.distances.data, *near = rays.inverses.data, *fall = rays.falls.data;
const float* bulge = dent.data + image * steps * rays.across;
float* out = (float*)hidden.data + image * steps * stride + lanes * m;
const Block number = numbers(lanes * m);
const Block slopes = rays.slope + number * rays.slopes_apart;
const Block longer = rays.spread * root(1.0f + slopes * slopes);
auto met = [&](int k) -> Block {
    const Block place = rays.starts.data[k] + number * rays.spacings.data[k];
    const Block bounded = most(least(place, none + (float)last), none);
    Places side = whole(least(bounded, none + ((float)last - 0.5f)));
    const Block part = bounded - real(side);
    const float* from = bulge + (rays.forward ? k : steps - 1 - k) * rays.step_stride;
    side *= rays.side_stride;
    const Block lower = take(from, side), upper = take(from + rays.side_stride, side);
    const Block away = most(place - bounded, bounded - place);
    const Block inside = lower + part * (upper - lower);
    return least(most(1.0f - away, none) * inside, inside);
};
// What is done with each cell that rays are in, or beside, in steps from one to another
auto seen = [&](int low, int high, int from, int to, auto act) {
    auto place = [&](int n, int k) {
        return rays.starts.data[k] + (lanes * m + n) * rays.spacings.data[k];
    };
    const float lowest = wp::min(place(low - 1, from), place(low - 1, to)) - 1.0f;
    const float highest = wp::max(place(high + 1, from), place(high + 1, to)) + 1.0f;
    if (highest < 0.0f || lowest > last) return;
    const int side_from = (int)wp::max(lowest, 0.0f) / lanes;
    const int side_to = (int)wp::min(highest, (float)last) / lanes;
    const int step_from = (rays.forward ? from : steps - 1 - to) / lanes;
    const int step_to = (rays.forward ? to : steps - 1 - from) / lanes;
    for (int step = step_from; step <= step_to; ++step)
        for (int side = side_from; side <= side_to; ++side) {
            const int row = rays.along_columns ? side : step;
            const int column = rays.along_columns ? step : side;
            act((image * cells.shape[1] + row) * cells.shape[2] + column);
        }
};
// By how much farther across a ray is in a step than in the one before
auto moved = [&](int ray, int k) {
    const float apart = rays.spacings.data[k] / (rays.slopes_apart * far[k]);
    return (rays.slope + ray * rays.slopes_apart) * (far[1] - far[0]) * apart;
};
Block edge = none + NOTHING, cut = none;
bool is_lit = true, is_behind = false;
for (int begin = 0; begin < steps; begin += lanes > 1 ? lanes : steps) {
    const int end = lanes > 1 && begin + lanes < steps ? begin + lanes : steps;
    const int before = begin > 0 ? begin - 1 : 0;
    const int tile = (image * ((steps + lanes - 1) / lanes) + begin / lanes) * rays.pitch + m;
    if (lanes > 1) {
        float steepest = 0.0f, highest = 0.0f;
        seen(0, lanes - 1, before, end - 1, [&](int at) {
            const float* cell = (const float*)(cells.data + at);
            steepest = wp::max(steepest, cell[0]), highest = wp::max(highest, cell[1]);
        });
        const float left = moved(lanes * m, end - 1), right = moved(lanes * (m + 1), end - 1);
        const float sideways = wp::max(fabsf(left), fabsf(right));
        // By what the gel may fall from step to step, and lets all of the light pass
        const float drop = end > 1 ? far[end - 1] * (fall[end - 2] - fall[end - 1]) : 0.0f;
        const float turn = highest * (far[1] - far[0]) * near[before];
        if (is_lit && (1.0f + sideways) * steepest + turn <= 0.99f * drop) {
            if (shaded.data[tile])
                for (int k = begin; k < end; ++k) store(out + k * stride, none);
            shaded.data[tile] = 0;
            is_behind = true;
            continue;
        }
    }
    if (is_behind) {
        edge = met(before) * near[before] - fall[before];
        cut = none + far[before];
        is_behind = false;
    }
    Block any = none, share = none;
    for (int k = begin; k < end; ++k) {
        const Block here = met(k), over = far[k] * (edge + fall[k]) - here;
        const Block wide = rays.softness + longer * (far[k] - cut);
        share = most(least(over / wide, none + 1.0f), none);
        const Block slope = here * near[k] - fall[k];
        cut = slope > edge ? none + far[k] : cut;
        edge = most(slope, edge);
        store(out + k * stride, share);
        any = most(any, share);
    }
    is_lit = !(largest(share) > 0.0f);
    if (lanes == 1) continue;
    shaded.data[tile] = largest(any) > 0.0f;
    if (shaded.data[tile])
        seen(first_over(any), last_over(any), begin, end - 1, [&](int at) { marks.data[at] = 1; });
}

// snippet darken
// include block
const int samples = layout.samples, steps = rays.starts.shape[0], plane = lanes * layout.plane;
// include blocks
    bool is_marked = lanes == 1;
    for (int i = row * samples / lanes; i <= ((row + 1) * samples - 1) / lanes && !is_marked; ++i)
        for (int j = k * samples; j < (k + 1) * samples && j < marks.shape[2]; ++j)
            if (marks.data[(image * marks.shape[1] + i) * marks.shape[2] + j]) is_marked = true;
    if (!is_marked) continue;
    const float *along_at = (const float*)along.data + lanes * place;
    const float *across_at = (const float*)across.data + lanes * place;
    const float* hidden_at = (const float*)hidden.data + image * steps * rays.pitch * lanes;
    Block lost = none;
    const Block pixels = least(numbers(lanes * k), none + (float)(layout.columns - 1));
    for (int s = 0; s < samples * samples; ++s) {
        const Block i = none + (float)(row * samples + s / samples);
        const Block j = pixels * (float)samples + (float)(s % samples);
        const Block side = rays.along_columns ? i : j;
        Places step = whole(rays.along_columns ? j : i);
        if (!rays.forward) step = steps - 1 - step;
        const Block start = take(rays.starts.data, step);
        const Block per_spacing = take(rays.per_spacing.data, step);
        const Block ray = most((side - start) * per_spacing, none);
        const Places before = whole(ray), from = step * (rays.pitch * lanes) + before;
        const Block lower = take(hidden_at, from), upper = take(hidden_at + 1, from);
        const Block share = lower + (ray - real(before)) * (upper - lower);
        if (!(largest(share) > 0.0f)) continue;
        const Block p = load(along_at + s * plane), q = load(across_at + s * plane);
        const Block upright = root(most(1.0f - p * p - q * q, none));
        const Block x = (rays.column - j) * rays.per_column, y = (rays.row - i) * rays.per_row;
        const Block facing = x * p + y * q + rays.height * upright;
        lost += share * most(facing, none) / root(x * x + y * y + rays.height * rays.height);
    }
    if (!(largest(lost) > 0.0f)) continue;
    for (int c = 0; c < 3; ++c) {
        const float* gain_at = (const float*)gain.data + c * channel + lanes * pixel;
        float* to = (float*)change.data + lanes * c * change.shape[1];
        to += image * channel + lanes * pixel;
        store(to, load(to) - colour[c] / (samples * samples) * lost * load(gain_at));
    }
}

// snippet blur
// include block
// include blocks
    const int at = (image * layout.rows + row) * (layout.blocks + 2 * room) + room + k;
    for (int c = 0; c < 3; ++c) {
        const float* from = (const float*)change.data + lanes * c * change.shape[1];
        from += image * channel + lanes * k;
        Block total = none;
        for (int d = 0; d < weights.shape[0]; ++d) {
            int beside = row + d - weights.shape[0] / 2;
            if (beside < 0) beside = -beside;
            if (beside >= layout.rows) beside = 2 * layout.rows - 2 - beside;
            total += weights.data[d] * load(from + lanes * beside * layout.blocks);
        }
        store((float*)blurred_out.data + lanes * (c * blurred_out.shape[1] + at), total);
    }
}

// snippet expose
// include block
// include blocks
    const int reach = weights.shape[0] / 2, columns = layout.columns - k * lanes;
    unsigned char shown[3][lanes];
    const int at = (image * layout.rows + row) * (layout.blocks + 2 * room) + room + k;
    unsigned char* to = image_out.data + 3 * (image * layout.rows + row) * layout.columns;
    to += 3 * k * lanes;
    for (int c = 0; c < 3; ++c) {
        const float* from = (const float*)blurred.data - reach;
        from += lanes * (c * blurred.shape[1] + at);
        Block levels = load((const float*)base.data + c * channel + lanes * pixel);
        for (int d = 0; d < weights.shape[0]; ++d) levels += weights.data[d] * load(from + d);
        if (knee < 255.0f && largest(levels) > knee) {
            const Block over = most(levels - knee, none) * (1.0f / (255.0f - knee));
            levels = least(levels, none + knee) + (255.0f - knee) * (1.0f - power(-over));
        }
        keep(shown[c], least(most(levels + 0.5f, none), none + 255.0f));
    }
    for (int n = 0; n < lanes && n < columns; ++n)
        for (int c = 0; c < 3; ++c) to[3 * n + c] = shown[c][n];
}
