// Mean heights of what is solid and measured, in nodes of levels 2 to 4: what fill.comp fills holes from (the pull of push-pull:
// Gortler et al. 1996, section 3.4.2). Of four columns in a row, of four such rows, and of four nodes, each time rounded down.
// Reads the measured bits, level 0 of the pyramid, lists. One workgroup of 256 threads a section; x is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = PYRAMID_THREADS) in;

shared uint means[1024];

// Mean of those of four that are not 0, rounded down; 0: none is. Four wide codes have a sum of more than 32 bits: whole parts and
// what is left of each are added by themselves.
uint mean_of(uvec4 four) {
    uint n = 0u;
    for (int k = 0; k < 4; k++) n += four[k] != 0u ? 1u : 0u;
    if (n == 0u) return 0u;
    uvec4 whole = four / n, left = four - whole * n;
    return whole.x + whole.y + whole.z + whole.w + (left.x + left.y + left.z + left.w) / n;
}

void main() {
    uvec4 here = JOB[gl_WorkGroupID.x].near[4];
    uvec2 derived = here.xy;
    uint lane = gl_LocalInvocationID.x;
    if (JOB[gl_WorkGroupID.x].lists == 0u) return;
    begin_form(gl_WorkGroupID.x);

    for (uint k = lane; k < 1024u; k += PYRAMID_THREADS) {
        uvec4 four = uvec4(0u);
        for (uint n = 0u; n < 4u; n++) {
            uvec2 node = uvec2((k & 31u) * 2u + (n & 1u), (k >> 5u) * 2u + (n >> 1u));
            uint block = node.y << DERIVED_BLOCKS_LOG2 | node.x, list = list_of(derived, block);
            uint from = list != 0u ? codes_at(list, OF_SOLID, form) : block * block_words(form);
            uvec4 rows = uvec4(0u);
            for (uint row = 0u; row < 4u; row++) {
                uvec4 codes = list != 0u ? load_four(derived, from, row * 4u) : load_tops(derived, from, row * 4u);
                for (uint x = 0u; x < 4u; x++)
                    if (!is_measured(derived, node * 4u + uvec2(x, row), form)) codes[x] = 0u;
                rows[row] = mean_of(codes);
            }
            four[n] = mean_of(rows);
            pool_store(derived, mean_at(2u, node, form), four[n]);
        }
        means[k] = mean_of(four);
    }
    for (uint level = 3u; level <= MEANS_LEVEL; level++) {
        uint side = SECTION_SIDE >> level;
        barrier();
        for (uint k = lane; k < side * side; k += PYRAMID_THREADS)
            pool_store(derived, mean_at(level, uvec2(k % side, k / side), form), means[k]);
        uint half_side = side / 2u, mean = 0u;
        // From 16x16 on, a level has no more nodes than there are threads.
        if (lane < half_side * half_side) {
            uint k = lane / half_side * 2u * side + lane % half_side * 2u;
            mean = mean_of(uvec4(means[k], means[k + 1u], means[k + side], means[k + side + 1u]));
        }
        barrier();
        if (lane < half_side * half_side) means[lane] = mean;
    }
}
