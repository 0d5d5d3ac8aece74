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
    uvec2 place = JOB[gl_WorkGroupID.x].near[4];
    uint lane = gl_LocalInvocationID.x;
    bool wide = (pool_load(place, HEADER_CODE) & 0x100u) != 0u;
    uint pyramid = pool_load(place, HEADER_PYRAMID);

    for (uint k = lane; k < 1024u; k += 256u) {
        uint first = pyramid_offset(2u) + (k >> 5u) * 2u * 64u + (k & 31u) * 2u;
        codes[k] = max(max(load_code(place, pyramid, first, wide), load_code(place, pyramid, first + 1u, wide)),
                       max(load_code(place, pyramid, first + 64u, wide), load_code(place, pyramid, first + 65u, wide)));
    }
    for (uint level = 3u; level <= 8u; level++) {
        uint side = SECTION_SIDE >> level;
        barrier();
        for (uint k = lane; k < side * side; k += 256u) {
            if (wide) pool_store(place, pyramid + pyramid_offset(level) + k, codes[k]);
            else if ((k & 1u) == 0u) {
                uint other = k + 1u < side * side ? codes[k + 1u] : 0u;
                pool_store(place, pyramid + (pyramid_offset(level) + k) / 2u, codes[k] | other << 16u);
            }
        }
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
