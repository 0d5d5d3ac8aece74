// Bridges small holes from what lies around them; then levels 1 and 2 of the pyramid.
// Reads the measured bits, level 0 and what is shown of the section and its eight neighbours; writes the holes of level
// 0 and of what is shown, and levels 1 and 2. One thread a half block of those that the job is for; y is the job.
//
// A hole is bridged where measured columns lie on both sides of it, at most `bridge` holes between them, along
// a row, a column or a diagonal; the shortest gap wins, then the flatter one. Between ends of similar height
// the top is interpolated; where they differ steeply (an eave and the ground) the lower one goes on, so that
// walls stay upright. The result depends only on measured columns, never on section borders.
//
// What is read of measured columns others may write at that time, but only as it is.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = DERIVE_THREADS) in;

// The section, and those that the half block may reach into. The last word: its form.
uvec4 here, beside, above, across;

uvec4 section_of(bool x, bool y) { return mix(mix(here, beside, bvec4(x)), mix(above, across, bvec4(x)), bvec4(y)); }

// Which columns of a half block are measured.
uint measured(ivec2 half_block) {
    uvec4 section = section_of(uint(half_block.x) > HALF_BLOCKS.x - 1u, uint(half_block.y) > HALF_BLOCKS.y - 1u);
    uvec2 at = uvec2(half_block) & uvec2(31u, 63u);
    uint columns = 0u;
    if (section.xy != uvec2(0u))
        columns = pool_load(section.xy, (at.y << DERIVED_BLOCKS_LOG2 | at.x * 2u) * block_words(section.w) + measured_in_block(section.w));
    return columns;
}

// Lattice height of a measured column.
int height_at(ivec2 column) {
    uvec4 section = section_of(uint(column.x) > SECTION_SIDE - 1u, uint(column.y) > SECTION_SIDE - 1u);
    uvec2 at = uvec2(column) & (SECTION_SIDE - 1u);
    return int(section.z) + int(solid_code(section.xy, at, section.w));
}

// Columns x - 4 to x + 4 of a row, from a byte of three half blocks side by side.
uint window(uvec3 rows, uint byte, uint x) {
    uvec3 row = rows >> 8u * byte & 0xFFu;
    return (row.x | row.y << 8u | row.z << 16u) >> (x + 4u);
}

void main() {
    uint job = gl_WorkGroupID.y, half_block;
    if (!half_block_of(gl_GlobalInvocationID.x, JOB[job].first, JOB[job].area, half_block)) return;
    begin_form(job);
    uvec2 origin = half_block_origin(half_block);
    ivec2 at = ivec2(origin / HALF_BLOCK), last = ivec2(HALF_BLOCKS - 1u);
    int i = at.x == 0 ? 0 : at.x == last.x ? 2 : 1, j = at.y == 0 ? 0 : at.y == last.y ? 2 : 1;
    here = JOB[job].near[4];
    beside = JOB[job].near[3 + i];
    above = JOB[job].near[3 * j + 1];
    across = JOB[job].near[3 * j + i];
    int reach = int(DERIVE.bridge);
    uint steep = JOB[job].steepest;
    uvec2 derived = here.xy;
    uint west = western_block(half_block);

    uvec3 south = uvec3(measured(at + ivec2(-1, -1)), measured(at + ivec2(0, -1)), measured(at + ivec2(1, -1)));
    uvec3 middle = uvec3(measured(at + ivec2(-1, 0)), measured(at), measured(at + ivec2(1, 0)));
    uvec3 north = uvec3(measured(at + ivec2(-1, 1)), measured(at + ivec2(0, 1)), measured(at + ivec2(1, 1)));

    uint holes = ~middle.y;
    while (holes != 0u) {
        uint k = uint(findLSB(holes));
        holes &= holes - 1u;
        uint x = k & 7u, y = k >> 3u;
        // Four rows to the south, the nearest in the highest byte; four to the north, the nearest in the lowest.
        uvec3 below = south >> 8u * y | middle << 24u - 8u * y << 8u;
        uvec3 over = middle >> 8u * y >> 8u | north << 24u - 8u * y;
        // Bit s - 1: the column s steps away is measured. By axis: row, column, diagonals.
        uvec4 near_bits = uvec4(0u), far_bits = uvec4(0u);
        uint row = window(middle, y, x);
        for (uint s = 1u; s <= 4u; s++) {
            uint b = window(below, 4u - s, x), o = window(over, s - 1u, x);
            near_bits |= (uvec4(row, b, b, o) >> uvec4(4u - s, 4u, 4u - s, 4u - s) & 1u) << s - 1u;
            far_bits |= (uvec4(row, o, o, b) >> uvec4(4u + s, 4u, 4u + s, 4u + s) & 1u) << s - 1u;
        }
        ivec4 near_steps = findLSB(near_bits) + 1, far_steps = findLSB(far_bits) + 1;
        ivec4 spans = near_steps + far_steps;
        // A diagonal step is longer: a gap of three counts as one of four.
        ivec4 gaps = ivec4(spans.xy - 1, spans.zw * 3 / 2 - 1);
        uvec4 spanned = uvec4(notEqual(near_bits, uvec4(0u))) & uvec4(notEqual(far_bits, uvec4(0u)))
                      & uvec4(lessThanEqual(gaps, ivec4(reach)));
        spans = mix(ivec4(99), spans, notEqual(spanned, uvec4(0u)));
        int span = min(min(spans.x, spans.y), min(spans.z, spans.w));
        spanned &= uvec4(equal(spans, ivec4(span)));
        uint axes = spanned.x | spanned.y << 1u | spanned.z << 2u | spanned.w << 3u;
        int near_all = near_steps.x | near_steps.y << 4 | near_steps.z << 8 | near_steps.w << 12;
        int far_all = far_steps.x | far_steps.y << 4 | far_steps.z << 8 | far_steps.w << 12;

        ivec2 column = ivec2(origin) + ivec2(x, y);
        int height = 0;
        uint best_drop = 0u;
        ivec2 source = ivec2(0);
        bool bridged = false;
        while (axes != 0u) {
            int a = findLSB(axes);
            axes &= axes - 1u;
            ivec2 axis = ivec2(a == 1 ? 0 : 1, a == 0 ? 0 : a == 3 ? -1 : 1);
            int near_step = near_all >> 4 * a & 15, far_step = far_all >> 4 * a & 15;
            int near_height = height_at(column - axis * near_step), far_height = height_at(column + axis * far_step);
            uint drop = uint(max(near_height, far_height)) - uint(min(near_height, far_height));
            if (!bridged || drop < best_drop) {
                bridged = true;
                best_drop = drop;
                bool near_is_source = near_step < far_step || (near_step == far_step && near_height <= far_height);
                if (drop <= steep * uint(span)) {
                    // Whole spans first, so that no product overflows.
                    int rise = far_height - near_height, whole = rise / span;
                    height = near_height + whole * near_step + (rise - whole * span) * near_step / span;
                } else {
                    near_is_source = near_height <= far_height;
                    height = min(near_height, far_height);
                }
                source = near_is_source ? -axis * near_step : axis * far_step;
            }
        }

        // A bridged height may lie outside what this section's code can say: it is held to its range.
        uint code = bridged ? uint(max(height, int(here.z) + 1)) - here.z : 0u;
        if (!WIDE) code = min(code, MOST_NARROW_CODE);
        uint first = west + (x >> 2u) * block_words(form), inner = in_block(uvec2(column));
        store_solid(derived, block_of(uvec2(column)), first, inner, code);
        uint shows = 0u;
        if (bridged) {
            ivec2 from = column + source;
            uvec4 section = section_of(uint(from.x) > SECTION_SIDE - 1u, uint(from.y) > SECTION_SIDE - 1u);
            shows = shown_of(section.xy, uvec2(from) & (SECTION_SIDE - 1u), section.w);
        }
        pool_store(derived, first + shown_in_block(form) + inner, shows);
    }

    store_levels_1_and_2(derived, half_block, west);
}
