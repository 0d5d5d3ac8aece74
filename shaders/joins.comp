// Of a smooth surface: what spans that float are joined with in the columns around, those of the same class whose heights differ by no
// more than a jump. See joins.glsl.
// Reads lists and spans of the section and of its eight neighbours; writes two words a span, and how far down the highest of those that
// touch reaches. One thread a column of the half blocks that the job is for, 32 of each; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"
#include "joins.glsl"

layout(local_size_x = DERIVE_THREADS) in;

uint job;
int slice_log2;
uint jump;

// The spans of a column of this section or of one around it.
struct Spans {
    uvec2 place;
    uint form;
    int base;
    uint from, count;
};

// What floats of a class in a column, whole: top, bottom.
struct Span {
    ivec2 ends;
    uint class_;
    bool thin;
};

Spans spans_in(ivec2 column) {
    // -1, 0 or 1 section on.
    ivec2 beyond = column >> int(SECTION_LOG2);
    uvec4 section = JOB[job].near[4 + beyond.x + 3 * beyond.y];
    Spans spans = Spans(section.xy, section.w, int(section.z), 0u, 0u);
    if (section.xy == uvec2(0u) || floats_of(section.w) == 0u) return spans;
    uvec2 at = uvec2(column) & (SECTION_SIDE - 1u);
    uint block = block_of(at), list = list_of(spans.place, block);
    if (list == 0u) return spans;
    uvec2 those = spans_of_column(spans.place, list, in_block(at));
    spans.from = spans_of(spans.place, block) + those.x * span_words(spans.form);
    spans.count = those.y;
    return spans;
}

uint class_at(Spans spans, uint k) { return pool_load(spans.place, spans.from + k * span_words(spans.form) + 1u + wide_of(spans.form)) >> SHOWN_CLASS_SHIFT; }
ivec2 ends_at(Spans spans, uint k) { return spans.base + ivec2(two_codes(spans.place, spans.from + k * span_words(spans.form), spans.form)); }
uint looked_at(Spans spans) { return min(spans.count, MOST_JOINED_RUNS); }

// The next of a class from run k on; false: there is none. k: where to go on.
bool next_of(Spans spans, uint class_, inout uint k, out Span span) {
    bool any = false;
    span.class_ = class_;
    for (; k < looked_at(spans); k++) {
        if (class_at(spans, k) != class_) continue;
        ivec2 ends = ends_at(spans, k);
        if (any && ends.x < span.ends.y) break;
        span.ends = any ? ivec2(span.ends.x, min(span.ends.y, ends.y)) : ends;
        any = true;
    }
    span.thin = any && is_thin(span.ends, slice_log2);
    return any;
}

// Whether run k goes on from one above.
bool goes_on(Spans spans, uint k) {
    uint class_ = class_at(spans, k), next = 0u;
    bool any = false;
    int bottom = 0;
    for (uint n = 0u; n < k; n++) {
        if (class_at(spans, n) != class_) continue;
        ivec2 ends = ends_at(spans, n);
        bottom = any && ends.x >= bottom ? min(bottom, ends.y) : ends.y;
        any = true;
    }
    return any && ends_at(spans, k).x >= bottom;
}

uint apart(int a, int b) { return uint(max(a, b)) - uint(min(a, b)); }

// Height at which a tube in the middle of another column, `middle` high, meets a span.
int meets(Span span, int middle) { return span.thin ? middle_of(span.ends) : clamp(middle, span.ends.y, span.ends.x); }

// Of the spans of a column the one of a class that is nearest to a tube, `middle` high, and no farther than a jump; `height`: where
// they meet.
bool nearest(Spans spans, uint class_, int middle, bool thin, out Span found, out int height) {
    uint least = jump;
    bool any = false;
    height = 0;
    Span span;
    for (uint k = 0u; next_of(spans, class_, k, span);) {
        if (thin && !span.thin) continue;
        int at = meets(span, middle);
        uint off = apart(at, middle);
        if (off > jump || any && off >= least) continue;
        least = off;
        any = true;
        height = at;
        found = span;
    }
    return any;
}

// Bytes of a tube; `sheet`: it is one of many.
uvec2 tube_joins(ivec2 column, Spans own, Span span, out bool sheet) {
    int middle = middle_of(span.ends), step_log2 = end_step(slice_log2), from = rounded(middle, step_log2, 0);
    bool joined[8];
    int heights[8];
    uint many = 0u, ends = 0u, only = 8u;
    for (uint d = 0u; d < 8u; d++) {
        Span beside, back;
        int at;
        joined[d] = nearest(spans_in(column + way(d)), span.class_, middle, false, beside, heights[d]);
        // Two tubes are joined if each is the other's nearest.
        if (joined[d] && beside.thin) joined[d] = nearest(own, span.class_, heights[d], true, back, at) && back.ends == span.ends;
        if (joined[d]) many++;
    }
    sheet = many >= LEAST_SHEET && !is_wire(span.class_);
    uvec2 words = uvec2(0u);
    for (uint d = 0u; d < 8u; d++) {
        uint code = NO_END;
        uint before = d + 7u & 7u, after = d + 1u & 7u;
        bool corner = (d & 1u) != 0u, is_end = joined[d] && ends < 7u;
        // Where four columns meet their tubes do, too, and not on the borders beside.
        bool all_four = corner && joined[d] && joined[before] && joined[after];
        if (corner && !all_four) {
            // Not to a corner that is reached over a column beside both.
            if (joined[before] && apart(heights[before], heights[d]) <= jump || joined[after] && apart(heights[after], heights[d]) <= jump) is_end = false;
        } else if (!corner && (joined[before] && joined[before + 7u & 7u] || joined[after] && joined[after + 1u & 7u])) is_end = false;
        if (is_end) {
            int end = min(middle, heights[d]) + int(apart(middle, heights[d]) >> 1u);
            if (all_four) {
                int least = min(min(middle, heights[d]), min(heights[before], heights[after]));
                end = least + int(apart(middle, least) + apart(heights[d], least) + apart(heights[before], least) + apart(heights[after], least) >> 2u);
            }
            code = uint((rounded(end, step_log2, 0) - from) >> step_log2) & 0xFFu;
            ends++;
            only = all_four ? d : 8u;
        }
        words[d >> 2u] |= code << (d & 3u) * 8u;
    }
    // No spur: its own side of that corner.
    uint opposite = only + 4u & 7u;
    if (ends == 1u && only < 8u) words[opposite >> 2u] = words[opposite >> 2u] & ~(0xFFu << (opposite & 3u) * 8u) | END_ALONE << (opposite & 3u) * 8u;
    return words;
}

// Of the spans of a column that of a class with the top that is nearest to `top`.
bool nearest_top(Spans spans, uint class_, int top, out Span nearest) {
    bool found = false;
    uint least = 0u;
    Span span;
    for (uint k = 0u; next_of(spans, class_, k, span);) {
        uint off = apart(span.ends.x, top);
        if (found && off >= least) continue;
        found = true;
        least = off;
        nearest = span;
    }
    return found;
}

// The 3 x 3 columns around a span, row by row: whether they have one that it may share corners with, and its ends.
bool there[9];
ivec2 around[9];

// As high as each other, for corners.
uint level;

bool joins(uint a, uint b, uint end) { return there[a] && there[b] && apart(around[a][end], around[b][end]) <= level; }

// Mean height of what hangs together with the column at a corner: as corners.comp has it.
int corner(uint east, uint north, uint across, uint end) {
    bool east_across = joins(east, across, end), north_across = joins(north, across, end);
    bool with_east = joins(4u, east, end), with_north = joins(4u, north, end);
    bool with_across = with_east && east_across || with_north && north_across;
    with_east = with_east || with_across && east_across;
    with_north = with_north || with_across && north_across;
    int least = around[4][end];
    if (with_east) least = min(least, around[east][end]);
    if (with_north) least = min(least, around[north][end]);
    if (with_across) least = min(least, around[across][end]);
    uint sum = apart(around[4][end], least), n = 1u;
    if (with_east) { sum += apart(around[east][end], least); n++; }
    if (with_north) { sum += apart(around[north][end], least); n++; }
    if (with_across) { sum += apart(around[across][end], least); n++; }
    return least + int(sum / n);
}

// Bytes of a slab, or, where it is thick and none of many, of what is upright; `alone`: it shares nothing.
uvec2 slab_joins(ivec2 column, Span span, bool alone) {
    uint many = 0u;
    for (uint n = 0u; n < 9u; n++) {
        there[n] = false;
        if (n == 4u || alone) continue;
        Span beside;
        there[n] = nearest_top(spans_in(column + ivec2(n % 3u, n / 3u) - 1), span.class_, span.ends.x, beside);
        around[n] = beside.ends;
        if (there[n] && !beside.thin && apart(beside.ends.x, span.ends.x) <= jump) many++;
    }
    if (!span.thin && span.class_ != CLASS_BRIDGE_DECK && (many < LEAST_CROWN || is_wire(span.class_))) return uvec2(UPRIGHT);
    there[4] = true;
    // A parapet stays upright.
    level = span.class_ == CLASS_BRIDGE_DECK ? jump >> 1u : jump;
    around[4] = span.ends;
    int step_log2 = corner_step(slice_log2);
    ivec2 own = ivec2(rounded(span.ends.x, step_log2, 0), rounded(span.ends.y, step_log2, 0));
    uvec2 words = uvec2(0u);
    for (uint c = 0u; c < 4u; c++) {
        uint east = (c & 1u) != 0u ? 5u : 3u, north = (c & 2u) != 0u ? 7u : 1u, across = north + east - 4u;
        int top = rounded(corner(east, north, across, 0u), step_log2, 0);
        // Its top stays above its bottom.
        int bottom = min(rounded(corner(east, north, across, 1u), step_log2, 0), top - (1 << step_log2));
        words.x |= uint(top - own.x >> step_log2 & 0xFF) << 8u * c;
        words.y |= uint(max(bottom - own.y >> step_log2, -127) & 0xFF) << 8u * c;
    }
    return words;
}

void main() {
    uint thread = gl_GlobalInvocationID.x, half_block;
    job = gl_WorkGroupID.y;
    if (JOB[job].joins == 0u || !half_block_of(thread >> 5u, JOB[job].first, JOB[job].area, half_block)) return;
    ivec2 column = ivec2(half_block_origin(half_block) + uvec2(thread & 7u, thread >> 3u & 3u));
    slice_log2 = int(JOB[job].slice);
    jump = JOB[job].jump;
    Spans own = spans_in(column);
    uint heads = 0u;
    for (uint k = 0u; k < own.count; k++) {
        uint class_ = class_at(own, k), at = own.from + k * span_words(own.form);
        bool alone = k >= MOST_JOINED_RUNS || heads >= MOST_JOINED;
        uvec2 words = uvec2(JOINED_ABOVE);
        if (k >= MOST_JOINED_RUNS || !goes_on(own, k)) {
            Span span;
            uint next = k;
            if (k >= MOST_JOINED_RUNS || !next_of(own, class_, next, span)) {
                ivec2 ends = ends_at(own, k);
                span = Span(ends, class_, is_thin(ends, slice_log2));
            }
            words = uvec2(NO_END * 0x01010101u);
            bool slab = !span.thin || span.class_ == CLASS_BRIDGE_DECK;
            if (!slab && !alone) words = tube_joins(column, own, span, slab);
            if (slab) words = slab_joins(column, span, alone);
            heads++;
            // All of it: whoever reads this at the same time comes to the same end.
            uint bottom = uint(span.ends.y - own.base);
            if (WIDE) pool_store(own.place, at + 1u, bottom);
            else pool_store(own.place, at, pool_load(own.place, at) & MOST_NARROW_CODE | bottom << 16u);
        }
        pool_store(own.place, at + JOB[job].joins, words.x);
        pool_store(own.place, at + JOB[job].joins + 1u, words.y);
    }
}
