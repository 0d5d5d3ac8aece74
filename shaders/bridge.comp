// Level 0 to 2 of the pyramid: measured tops, and tops of small holes bridged from what lies around them.
// Reads the tops planes of the section and its eight neighbours; writes the bridges plane and levels 0 to 2.
// One workgroup an 8x8 block, one thread a column; y is the job.
//
// A hole is bridged where measured columns lie on both sides of it, at most `bridge` holes between them, along
// a row, a column or a diagonal; the shortest gap wins, then the flatter one. Between ends of similar height
// the top is interpolated; where they differ steeply (an eave and the ground) the lower one goes on, so that
// walls stay upright. The result depends only on measured columns, never on section borders.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = 64) in;

const int NONE = -2147483647 - 1;
const int HALO = 4;
const int TILE = 8 + 2 * HALO;

shared int tile[TILE * TILE]; // measured lattice heights around the block
shared uint codes[64];
shared uint sources[64];

int measured(uint job, ivec2 column) {
    ivec2 side = (column >> int(SECTION_LOG2)) + 1; // 0..2: west/south, here, east/north
    uvec2 place = JOB[job].near[side.y * 3 + side.x];
    if (place == uvec2(0)) return NONE;
    uint run = pool_load(place, pool_load(place, HEADER_TOPS) + block_order(uvec2(column) & (SECTION_SIDE - 1u)));
    if (run == NO_RUN) return NONE;
    uint code = pool_load(place, HEADER_CODE);
    uint height = load_code(place, pool_load(place, HEADER_HEIGHTS), run, (code & 0x100u) != 0u);
    return int(pool_load(place, HEADER_BASE)) + int(height);
}

int tile_at(ivec2 inner) { return tile[(inner.y + HALO) * TILE + inner.x + HALO]; }

void main() {
    uint job = gl_WorkGroupID.y, block = gl_WorkGroupID.x, lane = gl_LocalInvocationID.x;
    uvec2 place = JOB[job].near[4];
    ivec2 origin = ivec2(block & 31u, block >> 5u) * 8;
    ivec2 inner = ivec2(lane & 7u, lane >> 3u);
    int reach = int(DERIVE.bridge);

    if (reach == 0) {
        tile[(inner.y + HALO) * TILE + inner.x + HALO] = measured(job, origin + inner);
    } else {
        for (int k = int(lane); k < TILE * TILE; k += 64)
            tile[k] = measured(job, origin + ivec2(k % TILE, k / TILE) - HALO);
    }
    barrier();

    int height = tile_at(inner);
    ivec2 source = ivec2(0);
    bool bridged = false;
    if (height == NONE && reach > 0) {
        const ivec2 axes[4] = ivec2[](ivec2(1, 0), ivec2(0, 1), ivec2(1, 1), ivec2(1, -1));
        int best_span = 99, best_drop = 0;
        for (int a = 0; a < 4; a++) {
            int near_steps = 0, far_steps = 0, near_height = NONE, far_height = NONE;
            for (int s = 1; s <= HALO && near_height == NONE; s++) {
                near_height = tile_at(inner - axes[a] * s);
                near_steps = s;
            }
            for (int s = 1; s <= HALO && far_height == NONE; s++) {
                far_height = tile_at(inner + axes[a] * s);
                far_steps = s;
            }
            if (near_height == NONE || far_height == NONE) continue;
            int span = near_steps + far_steps;
            int drop = abs(near_height - far_height);
            // A diagonal step is longer: a gap of three counts as one of four.
            int gap = a < 2 ? span - 1 : (span * 3) / 2 - 1;
            if (gap > reach || span > best_span || (span == best_span && bridged && drop >= best_drop)) continue;
            bridged = true;
            best_span = span;
            best_drop = drop;
            bool near_is_source = near_steps < far_steps || (near_steps == far_steps && near_height <= far_height);
            if (drop <= DERIVE.steep * span) {
                // Heights above the nearer end stay small, so the product cannot overflow.
                height = near_height + (far_height - near_height) * near_steps / span;
            } else {
                near_is_source = near_height <= far_height;
                height = min(near_height, far_height);
            }
            source = near_is_source ? -axes[a] * near_steps : axes[a] * far_steps;
        }
    }

    uint code_word = pool_load(place, HEADER_CODE);
    bool wide = (code_word & 0x100u) != 0u;
    int base = int(pool_load(place, HEADER_BASE));
    uint code = 0u;
    if (height != NONE) {
        // A bridged height may lie outside what this section's code can say: it is held to its range.
        code = uint(max(height - base, 1));
        if (!wide) code = min(code, 0xFFFFu);
    }
    codes[lane] = code;
    sources[lane] = bridged ? encode_bridge(source) : 0u;
    barrier();

    uint pyramid = pool_load(place, HEADER_PYRAMID);
    if ((lane & 3u) == 0u) {
        uint four = sources[lane] | sources[lane + 1u] << 8u | sources[lane + 2u] << 16u | sources[lane + 3u] << 24u;
        pool_store(place, pool_load(place, HEADER_BRIDGES) + block * 16u + lane / 4u, four);
    }
    uint at = uint(origin.y + inner.y) * SECTION_SIDE + uint(origin.x + inner.x);
    if (wide) pool_store(place, pyramid + at, code);
    else if ((lane & 1u) == 0u) pool_store(place, pyramid + at / 2u, code | codes[lane + 1u] << 16u);

    // Levels 1 (4x4 a block) and 2 (2x2); a block starts at an even element of their rows.
    for (uint level = 1u; level <= 2u; level++) {
        uint side = 8u >> level;
        uvec2 node = uvec2(lane % side, lane / side);
        uint top = 0u;
        if (lane < side * side) {
            uint k = node.y * 2u * (side * 2u) + node.x * 2u;
            top = max(max(codes[k], codes[k + 1u]), max(codes[k + side * 2u], codes[k + side * 2u + 1u]));
        }
        barrier();
        if (lane < side * side) codes[lane] = top;
        barrier();
        if (lane < side * side) {
            uint element = pyramid_offset(level) + (uint(origin.y >> level) + node.y) * (SECTION_SIDE >> level)
                         + uint(origin.x >> level) + node.x;
            if (wide) pool_store(place, pyramid + element, top);
            else if ((lane & 1u) == 0u) pool_store(place, pyramid + element / 2u, top | codes[lane + 1u] << 16u);
        }
    }
}
