// Levels 3 to 8 of the maximum pyramid, from level 2 (Tevs et al. 2008).
// One workgroup of 256 threads a section; x is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = 256) in;

shared uint codes[1024];

void main() {
    uvec2 derived = JOB[gl_WorkGroupID.x].near[4].xy;
    uint lane = gl_LocalInvocationID.x;

    for (uint k = lane; k < 1024u; k += 256u) {
        uint block = k * BLOCK_ELEMENTS;
        uvec4 tops = load_four(derived, block + LEVEL_2);
        tops.xy = max(tops.xy, tops.zw);
        codes[k] = max(tops.x, tops.y);
        store_two(derived, block + LEVEL_3, uvec2(codes[k], 0u));
    }
    for (uint level = 3u; level <= 8u; level++) {
        uint side = SECTION_SIDE >> level;
        barrier();
        uint k = lane * 2u;
        if (level > 3u && k < side * side)
            store_two(derived, upper_level(level) + k, uvec2(codes[k], side > 1u ? codes[k + 1u] : 0u));
        uint half_side = side / 2u;
        uint top = 0u;
        // From 16x16 on, a level has no more nodes than there are threads.
        if (lane < half_side * half_side) {
            k = lane / half_side * 2u * side + lane % half_side * 2u;
            top = max(max(codes[k], codes[k + 1u]), max(codes[k + side], codes[k + side + 1u]));
        }
        barrier();
        if (lane < half_side * half_side) codes[lane] = top;
    }
}
