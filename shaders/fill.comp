// Fills what is left open of the ground beneath what floats and between it, from the means of nodes around: the finest level that has any beside
// the column, of the four nearest nodes between them (the push of push-pull); then levels 1 and 2 of the pyramid. Not across the
// section's border.
// Reads lists, means, the measured bits and level 0; writes holes of level 0 and of what is shown, and levels 1 and 2. One thread a
// half block of those that the job is for; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = DERIVE_THREADS) in;

uvec2 derived;

// Whether anything is measured in a derived block, or floats there; beyond the section's border: yes.
bool holds_any(ivec2 block) {
    if (any(notEqual(block & int((1u << DERIVED_BLOCKS_LOG2) - 1u), block))) return true;
    uint at = uint(block.y) << DERIVED_BLOCKS_LOG2 | uint(block.x);
    uint bits = pool_load(derived, (at & ~1u) * block_words(IS_WIDE) + measured_in_block(IS_WIDE));
    if ((bits >> (at & 1u) * 4u & 0x0F0F0F0Fu) != 0u) return true;
    uint list = list_of(derived, at, IS_WIDE);
    return list != 0u && pool_load(derived, list + 1u + IS_WIDE + LIST_TOP) != 0u;
}

// Whether there is something on all sides of a derived block: it does not lie on the border of what there is.
bool is_inner(ivec2 block) {
    for (int k = 0; k < 9; k++) if (!holds_any(block + ivec2(k % 3, k / 3) - 1)) return false;
    return true;
}

// Whether anything floats in the derived blocks around one.
bool is_under(ivec2 block) {
    for (int k = 0; k < 9; k++) {
        ivec2 near = block + ivec2(k % 3, k / 3) - 1;
        if (any(notEqual(near & int((1u << DERIVED_BLOCKS_LOG2) - 1u), near))) continue;
        uint list = list_of(derived, uint(near.y) << DERIVED_BLOCKS_LOG2 | uint(near.x), IS_WIDE);
        if (list != 0u && pool_load(derived, list + 1u + IS_WIDE + LIST_TOP) != 0u) return true;
    }
    return false;
}

// Code for a column between the four nearest nodes of a level, and the nearest of these that has one; 0: none has.
uint between(uvec2 column, uint level, out uvec2 nearest) {
    vec2 at = (vec2(column) + 0.5) / float(1u << level) - 0.5;
    ivec2 first = ivec2(floor(at)), last = ivec2((SECTION_SIDE >> level) - 1u);
    vec2 beyond = at - vec2(first);
    uvec4 codes;
    vec4 weights;
    for (int k = 0; k < 4; k++) {
        ivec2 node = clamp(first + ivec2(k & 1, k >> 1), ivec2(0), last);
        codes[k] = pool_load(derived, mean_at(level, uvec2(node), IS_WIDE));
        vec2 weight = mix(1.0 - beyond, beyond, bvec2((k & 1) != 0, (k >> 1) != 0));
        weights[k] = codes[k] != 0u ? max(weight.x * weight.y, 1e-4) : 0.0;
    }
    nearest = uvec2(0u);
    float all = dot(weights, vec4(1.0)), best = 0.0, rise = 0.0;
    if (all == 0.0) return 0u;
    uint least = 0xFFFFFFFFu;
    for (int k = 0; k < 4; k++) if (codes[k] != 0u) least = min(least, codes[k]);
    for (int k = 0; k < 4; k++) {
        if (codes[k] == 0u) continue;
        rise += weights[k] / all * float(codes[k] - least);
        if (weights[k] > best) {
            best = weights[k];
            nearest = uvec2(clamp(first + ivec2(k & 1, k >> 1), ivec2(0), last));
        }
    }
    return least + uint(rise);
}

// A measured column of a node.
uvec2 measured_in(uvec2 node, uint level) {
    for (; level > 2u; level--) {
        uvec2 child = node * 2u;
        for (uint k = 0u; k < 4u; k++) {
            uvec2 at = node * 2u + uvec2(k & 1u, k >> 1u);
            if (pool_load(derived, mean_at(level - 1u, at, IS_WIDE)) != 0u) child = at;
        }
        node = child;
    }
    uvec2 column = node * 4u;
    for (uint k = 0u; k < 16u; k++) {
        uvec2 at = node * 4u + uvec2(k & 3u, k >> 2u);
        if (is_measured(derived, at, IS_WIDE)) column = at;
    }
    return column;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block;
    if (!half_block_of(gl_GlobalInvocationID.x, JOB[job].first, JOB[job].area, half_block)) return;
    if (JOB[job].lists == 0u) return;
    uvec4 here = JOB[job].near[4];
    derived = here.xy;
    uvec2 origin = half_block_origin(half_block);
    uint west = western_block(half_block, IS_WIDE);
    bool filled = false;
    for (uint side = 0u; side < 2u; side++) {
        uint first = west + side * block_words(IS_WIDE);
        ivec2 block = ivec2(origin >> 2u) + ivec2(side, 0);
        if (!is_under(block)) continue;
        bool inner_block = is_inner(block);
        uint list = list_of(derived, block_of(origin) + side, IS_WIDE);
        for (uint inner = 0u; inner < 16u; inner++) {
            uvec2 column = origin + uvec2(side * 4u + (inner & 3u), inner >> 2u), nearest;
            uint code = solid_code(derived, column, IS_WIDE);
            if (code != 0u || !(inner_block || list != 0u && floating_top(derived, list, inner, IS_WIDE) != 0u)) continue;
            for (uint level = 2u; level <= MEANS_LEVEL && code == 0u; level++) {
                code = between(column, level, nearest);
                if (code == 0u) continue;
                filled = true;
                uint shows = shown_of(derived, measured_in(nearest, level), IS_WIDE);
                pool_store(derived, first + shown_in_block(IS_WIDE) + inner, shows);
                store_solid(derived, first, list, inner, code);
            }
        }
    }
    if (filled) store_levels_1_and_2(derived, half_block, west, JOB[job].lists != 0u);
}
