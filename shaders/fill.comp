// Fills what is left open of the ground beneath what floats and between it, from the means of nodes around: of the finest of levels 2
// to 4 that has any among the 3x3 nodes around the column (the push of push-pull); then levels 1 and 2 of the pyramid. So what has
// a measured column within 16 columns, of rows and of columns alike, is filled, and what has none within 31 stays open. Not across the
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

// Whether anything floats in a derived block.
bool floats_in(uint block) {
    uint list = list_of(derived, block);
    return list != 0u && pool_load(derived, list + LIST_TOP) != 0u;
}

// Whether anything is measured in a derived block, or floats there; beyond the section's border: yes.
bool holds_any(ivec2 block) {
    if (any(notEqual(block & int((1u << DERIVED_BLOCKS_LOG2) - 1u), block))) return true;
    uint at = uint(block.y) << DERIVED_BLOCKS_LOG2 | uint(block.x);
    uint bits = pool_load(derived, (at & ~1u) * block_words(form) + measured_in_block(form));
    if ((bits >> (at & 1u) * 4u & 0x0F0F0F0Fu) != 0u) return true;
    return floats_in(at);
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
        if (floats_in(uint(near.y) << DERIVED_BLOCKS_LOG2 | uint(near.x))) return true;
    }
    return false;
}

// Code for a column from the 3x3 nodes of a level around it, and that of these which has the largest share; 0: none has any.
// Of three nodes in a row a square of two nodes' length around the column has its shares, smeared by a node's length:
// they go over evenly from column to column, and no column farther away than two nodes' length counts. Whole numbers, so that
// every device comes to the same.
uint around(uvec2 column, uint level, out uvec2 nearest) {
    uint size = 1u << level;
    uvec2 beyond = (column & size - 1u) * 2u + 1u;
    uvec3 of_x = uvec3(2u * size - beyond.x, 2u * size, beyond.x), of_y = uvec3(2u * size - beyond.y, 2u * size, beyond.y);
    ivec2 first = ivec2(column >> level) - 1;
    uint codes[9], shares[9], sum = 0u, best = 0u;
    for (int k = 0; k < 9; k++) {
        ivec2 node = first + ivec2(k % 3, k / 3);
        codes[k] = 0u;
        if (all(lessThan(uvec2(node), uvec2(SECTION_SIDE >> level)))) codes[k] = pool_load(derived, mean_at(level, uvec2(node), form));
        shares[k] = codes[k] != 0u ? of_x[k % 3] * of_y[k / 3] : 0u;
        sum += shares[k];
        if (shares[k] > best) {
            best = shares[k];
            nearest = uvec2(node);
        }
    }
    if (sum == 0u) return 0u;
    // The sum of shares is at most 4,096: nothing overflows.
    uint whole = 0u, left = 0u;
    for (int k = 0; k < 9; k++) {
        whole += codes[k] / sum * shares[k];
        left += codes[k] % sum * shares[k];
    }
    return whole + left / sum;
}

// A measured column of a node: the last, half by half, of 4x4 columns row by row.
uvec2 measured_in(uvec2 node, uint level) {
    for (; level > 2u; level--) {
        uvec2 child = node * 2u;
        for (uint k = 0u; k < 4u; k++) {
            uvec2 at = node * 2u + uvec2(k & 1u, k >> 1u);
            if (pool_load(derived, mean_at(level - 1u, at, form)) != 0u) child = at;
        }
        node = child;
    }
    uvec2 column = node * 4u;
    for (uint k = 0u; k < 16u; k++) {
        uvec2 at = node * 4u + uvec2(k & 3u, k >> 2u);
        if (is_measured(derived, at, form)) column = at;
    }
    return column;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block;
    if (!half_block_of(gl_GlobalInvocationID.x, JOB[job].first, JOB[job].area, half_block)) return;
    if (JOB[job].lists == 0u) return;
    begin_form(job);
    uvec4 here = JOB[job].near[4];
    derived = here.xy;
    uvec2 origin = half_block_origin(half_block);
    uint west = western_block(half_block);
    bool filled = false;
    for (uint side = 0u; side < 2u; side++) {
        uint first = west + side * block_words(form);
        ivec2 block = ivec2(origin >> 2u) + ivec2(side, 0);
        if (!is_under(block)) continue;
        bool inner_block = is_inner(block);
        uint at = block_of(origin) + side, list = list_of(derived, at);
        for (uint inner = 0u; inner < 16u; inner++) {
            uvec2 column = origin + uvec2(side * 4u + (inner & 3u), inner >> 2u), nearest;
            uint code = solid_code(derived, column, form);
            if (code != 0u || !(inner_block || list != 0u && floating_ends(derived, at, list, inner, form).x != 0u)) continue;
            for (uint level = 2u; level <= MEANS_LEVEL && code == 0u; level++) {
                code = around(column, level, nearest);
                if (code == 0u) continue;
                filled = true;
                uint shows = shown_of(derived, measured_in(nearest, level), form);
                pool_store(derived, first + shown_in_block(form) + inner, shows);
                store_solid(derived, at, first, inner, code);
            }
        }
    }
    if (filled) store_levels_1_and_2(derived, half_block, west);
}
