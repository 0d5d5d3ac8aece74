// Heights of the four corners of each column, for the surface between them: of the 2x2 columns that meet at a corner the mean top
// of those that hang together with the column, side by side, without a jump. So columns of one surface share the corner, and at a
// jump each side has its own. Then levels 1 and 2 of the pyramid, which no corner is above, nor what spans are joined with.
// Reads level 0 of the section and of its eight neighbours, and what its spans are joined with; writes corners, and levels 1 and 2. One thread a half block of those
// that the job is for; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"
#include "corners.glsl"
#include "joins.glsl"

layout(local_size_x = DERIVE_THREADS) in;

// The half block's columns and those around it.
const uint EAST = HALF_BLOCK_EAST + 2u, NORTH = HALF_BLOCK_NORTH + 2u;
int heights[EAST * NORTH];
bool there[EAST * NORTH];

uint jump;

bool joins(uint a, uint b) {
    return there[a] && there[b] && uint(max(heights[a], heights[b])) - uint(min(heights[a], heights[b])) <= jump;
}

// Height of the corner of a column; `east` and `north`: those beside it there.
int corner(uint column, uint east, uint north, uint across) {
    bool east_across = joins(east, across), north_across = joins(north, across);
    bool with_east = joins(column, east), with_north = joins(column, north);
    bool with_across = with_east && east_across || with_north && north_across;
    with_east = with_east || with_across && east_across;
    with_north = with_north || with_across && north_across;
    int least = heights[column];
    if (with_east) least = min(least, heights[east]);
    if (with_north) least = min(least, heights[north]);
    if (with_across) least = min(least, heights[across]);
    uint sum = uint(heights[column] - least), n = 1u;
    if (with_east) { sum += uint(heights[east] - least); n++; }
    if (with_north) { sum += uint(heights[north] - least); n++; }
    if (with_across) { sum += uint(heights[across] - least); n++; }
    return least + int(sum / n);
}

// Code that no span of a column leads above.
uint highest_join(uvec2 derived, uvec2 column, int slice_log2, uint joins, int half_cell) {
    uint block = block_of(column), list = list_of(derived, block);
    if (list == 0u) return 0u;
    uvec2 spans = spans_of_column(derived, list, in_block(column));
    uint from = spans_of(derived, block), bound = 0u;
    for (uint k = 0u; k < spans.y; k++) {
        uint at = from + (spans.x + k) * span_words(form);
        ivec2 ends = ivec2(two_codes(derived, at, form));
        uvec2 words = joins_at(derived, at + joins);
        int top = ends.x;
        if (is_joined_above(words) || is_upright(words)) {
            // No higher than it is.
        } else if (is_tube(words)) {
            ivec4 eight = max(four_bytes(words.x), four_bytes(words.y));
            int most = max(max(eight.x, eight.y), max(eight.z, eight.w));
            // Its ends are rounded down.
            if (most >= -126) top = max(top, middle_of(ends) + ((most + 1) << end_step(slice_log2)) + half_cell);
        } else {
            ivec4 four = span_corners(words.x, ends.x, slice_log2, 0);
            top = max(top, max(max(four.x, four.y), max(four.z, four.w)) + (1 << corner_step(slice_log2)));
        }
        bound = max(bound, uint(max(top, 0)));
    }
    return WIDE ? bound : min(bound, MOST_NARROW_CODE);
}

void main() {
    uint job = gl_WorkGroupID.y, half_block;
    if (!half_block_of(gl_GlobalInvocationID.x, JOB[job].first, JOB[job].area, half_block)) return;
    begin_form(job);
    uvec4 here = JOB[job].near[4];
    uvec2 derived = here.xy, origin = half_block_origin(half_block);
    uint corners = JOB[job].corners, west = western_block(half_block);
    jump = JOB[job].jump;

    for (uint k = 0u; k < EAST * NORTH; k++) {
        ivec2 column = ivec2(origin) + ivec2(k % EAST, k / EAST) - 1;
        // -1, 0 or 1 section on.
        ivec2 beyond = column >> int(SECTION_LOG2);
        uvec4 section = JOB[job].near[4 + beyond.x + 3 * beyond.y];
        uint code = 0u;
        uvec2 at = uvec2(column) & (SECTION_SIDE - 1u);
        if (section.xy != uvec2(0u)) code = solid_code(section.xy, at, section.w);
        there[k] = code != 0u;
        heights[k] = int(section.z) + int(code);
    }

    uint bounds[HALF_BLOCK_EAST * HALF_BLOCK_NORTH / 4u];
    for (uint k = 0u; k < bounds.length(); k++) bounds[k] = 0u;
    for (uint y = 0u; y < HALF_BLOCK_NORTH; y++) {
        for (uint x = 0u; x < HALF_BLOCK_EAST; x++) {
            uint k = (y + 1u) * EAST + x + 1u, bound = 0u;
            uvec4 codes = uvec4(0u);
            if (there[k]) {
                uint south = k - EAST, north = k + EAST;
                ivec4 four = ivec4(corner(k, k - 1u, south, south - 1u), corner(k, k + 1u, south, south + 1u),
                                   corner(k, k - 1u, north, north - 1u), corner(k, k + 1u, north, north + 1u));
                // What a neighbour leads to may lie outside what this section's code can say.
                codes = uvec4(max(four, int(here.z) + 1)) - here.z;
                if (!WIDE) codes = min(codes, MOST_NARROW_CODE);
                bound = max(uint(heights[k] - int(here.z)), max(max(codes.x, codes.y), max(codes.z, codes.w)));
            }
            uint at = corners_at(corners, origin + uvec2(x, y), IS_WIDE);
            if (WIDE) for (uint c = 0u; c < 4u; c++) pool_store(derived, at + c, codes[c]);
            else {
                pool_store(derived, at, codes.x | codes.y << 16u);
                pool_store(derived, at + 1u, codes.z | codes.w << 16u);
            }
            if (JOB[job].joins != 0u) {
                int half_cell = int(JOB[job].thickness + 1u >> 1u);
                bound = max(bound, highest_join(derived, origin + uvec2(x, y), int(JOB[job].slice), JOB[job].joins, half_cell));
            }
            uint node = (y >> 1u) * (HALF_BLOCK_EAST / 2u) + (x >> 1u);
            bounds[node] = max(bounds[node], bound);
        }
    }
    store_levels_1_and_2(derived, half_block, west, bounds);
}
