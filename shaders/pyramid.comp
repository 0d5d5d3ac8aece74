// Levels 3 to 8 of the maximum pyramid, from level 2 (Tevs et al. 2008).
// One workgroup of 256 threads a section; x is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = PYRAMID_THREADS) in;

shared uint codes[1024];

void main() {
    uvec2 derived = JOB[gl_WorkGroupID.x].near[4].xy;
    uint lane = gl_LocalInvocationID.x;

    begin_form(gl_WorkGroupID.x);
    uint first = upper_levels(form);
    for (uint k = lane; k < 1024u; k += PYRAMID_THREADS) {
        uint below = upper_level(2u) + (k >> 5u) * 2u * 64u + (k & 31u) * 2u;
        uvec2 tops = max(load_two(derived, first, below), load_two(derived, first, below + 64u));
        codes[k] = max(tops.x, tops.y);
    }
    for (uint level = 3u; level <= 8u; level++) {
        uint side = SECTION_SIDE >> level;
        barrier();
        for (uint k = lane * 2u; k < side * side; k += 2u * PYRAMID_THREADS)
            store_two(derived, first, upper_level(level) + k, uvec2(codes[k], side > 1u ? codes[k + 1u] : 0u));
        uint half_side = side / 2u;
        uint top = 0u;
        // From 16x16 on, a level has no more nodes than there are threads.
        if (lane < half_side * half_side) {
            uint k = lane / half_side * 2u * side + lane % half_side * 2u;
            top = max(max(codes[k], codes[k + 1u]), max(codes[k + side], codes[k + side + 1u]));
        }
        barrier();
        if (lane < half_side * half_side) codes[lane] = top;
    }
}
