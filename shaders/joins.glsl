// What spans of a smooth surface are joined with. What floats is round where it is alone, and a slab where it is one of many. What is thin (a
// wire, a twig) is a tube, from the middle of its column to the borders where spans of its kind go on, or, if they do so nearly
// all around, a slab. What is thick (a crown) is a slab if most around are as high, else it stands upright, as a tube would. A slab has a top and a
// bottom that are bilinear between corners, which it shares with those around. Decks of bridges are slabs, wires and towers none.
// Spans of a class that touch each other in a column are one thing: the highest of them reaches down to the bottom of the lowest then,
// and the others are told to belong to it.
// A span has two words for that, eight bytes, JOB's or the node's `joins` words behind the span itself. Of a tube: heights of
// its ends towards the eight columns around, counterclockwise from the east, NO_END where it has none, which is one of them at
// least; END_ALONE in place of one tells that nothing leads from its only end to its middle. Of a slab: heights of the corners of its top,
// south-west, south-east, north-west and north-east, then of its bottom; none is NO_END. Heights are rounded down to whole steps, 2^END_STEP or
// 2^SPAN_CORNER_STEP of them a slice, whichever column they are seen from, and counted from the span's own (the middle of a tube, top
// and bottom of a slab), rounded likewise.
// Needs floats.glsl.

// log2 of the highest slice.
const int MOST_SLICE = 30;

const uint CLASS_BRIDGE_DECK = 17u;

// Column beside one towards which byte k leads.
ivec2 way(uint k) {
    return ivec2(k < 2u || k == 7u ? 1 : k > 2u && k < 6u ? -1 : 0, k > 0u && k < 4u ? 1 : k > 4u ? -1 : 0);
}

// Spans around that make one of many: of what is thin, and of what is thick.
const uint LEAST_SHEET = 5u;
const uint LEAST_CROWN = 4u;

// Whether a span is thin; `ends`: its top and bottom.
bool is_thin(ivec2 ends, int slice_log2) { return uint(ends.x) - uint(ends.y) <= 1u << slice_log2; }
bool is_wire(uint class_) { return class_ >= 13u && class_ <= 16u; }

int middle_of(ivec2 ends) { return ends.y + int((uint(ends.x) - uint(ends.y)) >> 1u); }

// log2 of the steps that heights of ends, and those of corners, are rounded to.
int end_step(int slice_log2) { return max(slice_log2 - int(END_STEP), 0); }
int corner_step(int slice_log2) { return max(slice_log2 - int(SPAN_CORNER_STEP), 0); }

// `height` rounded down to whole steps; heights count from `anchor`.
int rounded(int height, int step_log2, int anchor) { return (height + anchor >> step_log2 << step_log2) - anchor; }

// Byte k of what a span is joined with; less than -126: no end.
int end_byte(uvec2 joins, uint k) { return bitfieldExtract(int(k < 4u ? joins.x : joins.y), int(k & 3u) * 8, 8); }
bool has_end(uvec2 joins, uint k) { return end_byte(joins, k) >= -126; }

ivec4 four_bytes(uint word) {
    return ivec4(bitfieldExtract(int(word), 0, 8), bitfieldExtract(int(word), 8, 8), bitfieldExtract(int(word), 16, 8), bitfieldExtract(int(word), 24, 8));
}

// Whether a span goes on from one above.
bool is_joined_above(uvec2 joins) { return joins.x == JOINED_ABOVE; }

bool is_upright(uvec2 joins) { return joins.x == UPRIGHT; }
bool is_tube(uvec2 joins) {
    bvec4 none = equal(ivec4(-128), min(four_bytes(joins.x), four_bytes(joins.y)));
    return any(none);
}

uvec2 joins_at(uvec2 place, uint at) { return uvec2(pool_load(place, at), pool_load(place, at + 1u)); }

// Heights of the corners of a span's top, or of its bottom.
ivec4 span_corners(uint bytes, int height, int slice_log2, int anchor) {
    int step_log2 = corner_step(slice_log2);
    return rounded(height, step_log2, anchor) + (four_bytes(bytes) << step_log2);
}
