// Nodes of levels 3 to 8 where things float, from the lists of blocks, and from level 2 of the pyramid where there are none: the
// highest thing that is solid, and the lowest bottom of what floats.
// One workgroup of 256 threads a section; x is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = PYRAMID_THREADS) in;

shared uvec2 nodes[1024];

uvec2 joined(uvec2 a, uvec2 b) { return uvec2(max(a.x, b.x), min(a.y, b.y)); }

void main() {
    uvec4 here = JOB[gl_WorkGroupID.x].near[4];
    uvec2 derived = here.xy;
    uint lane = gl_LocalInvocationID.x;
    if (JOB[gl_WorkGroupID.x].lists == 0u) return;

    for (uint k = lane; k < 1024u; k += PYRAMID_THREADS) {
        uvec2 node = uvec2(0u, no_bottom(IS_WIDE));
        for (uint n = 0u; n < 4u; n++) {
            uvec2 block = uvec2((k & 31u) * 2u + (n & 1u), (k >> 5u) * 2u + (n >> 1u));
            uint list = list_of(derived, block.y << DERIVED_BLOCKS_LOG2 | block.x, IS_WIDE);
            uvec2 of_block = uvec2(pyramid_code(derived, 2u, block, IS_WIDE), no_bottom(IS_WIDE));
            if (list != 0u) of_block = two_codes(derived, list, IS_WIDE);
            node = joined(node, of_block);
        }
        nodes[k] = node;
    }
    for (uint level = 3u; level <= 8u; level++) {
        uint side = SECTION_SIDE >> level;
        barrier();
        for (uint k = lane; k < side * side; k += PYRAMID_THREADS) {
            uint at = float_node_at(level, uvec2(k % side, k / side), IS_WIDE);
            if (WIDE) {
                pool_store(derived, at, nodes[k].x);
                pool_store(derived, at + 1u, nodes[k].y);
            } else pool_store(derived, at, nodes[k].x | nodes[k].y << 16u);
        }
        uint half_side = side / 2u;
        uvec2 node = uvec2(0u);
        // From 16x16 on, a level has no more nodes than there are threads.
        if (lane < half_side * half_side) {
            uint k = lane / half_side * 2u * side + lane % half_side * 2u;
            node = joined(joined(nodes[k], nodes[k + 1u]), joined(nodes[k + side], nodes[k + side + 1u]));
        }
        barrier();
        if (lane < half_side * half_side) nodes[lane] = node;
    }
}
