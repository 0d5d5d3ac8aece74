// Of stacks, where something may float: each column's solid part, from its highest solid span down, and the spans that float
// above it. What is always solid is; vegetation, wires and the like float; of what is not classified a span floats where at
// least three of the 5 x 5 columns around hold a lower point, beneath a gap, as where a laser sees through crowns; on the next level two of the
// 3 x 3, above that the column itself, which is as wide.
// Reads spans and lowest points; writes lists, spans that float, what columns show, the measured bits and level 0 of the pyramid, without bridges
// levels 1 and 2. One thread a half block; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"
#include "runs.glsl"
#include "stacks.glsl"

layout(local_size_x = DERIVE_THREADS) in;
layout(constant_id = ID_BRIDGE) const bool BRIDGE = false; // bridge.comp follows

const uint NOTHING_LOWER = 0xFFFFFFFFu;

int reach; // of what tells whether what is not classified floats
uint span; // where the next one goes
uint highest_of_all; // code of the block's highest span
uint highest, lowest; // codes of the column's highest top and lowest bottom of spans

// Of the columns within the reach of `column` the three whose lowest points are lowest, on coarser levels two or one: code of the
// highest of these points. What lies more than a gap above it lies so over all of them. As loops may take only so many turns (lavapipe:
// 65,535 a thread, all of its loops together), it is found once a column.
uint lowest_around(ivec2 column, int reach) {
    uvec3 least = uvec3(NOTHING_LOWER);
    int side = 2 * reach + 1;
    for (int k = 0; k < side * side; k++) {
        ivec2 near = column + ivec2(k % side, k / side) - reach;
        if (any(notEqual(near & int(SECTION_SIDE - 1u), near))) continue;
        uint list = list_of(derived, block_of(uvec2(near)));
        if (list == 0u) continue;
        uint there = code_in(derived, list, OF_LOWEST, in_block(uvec2(near)), form);
        if (there != 0u) least = uvec3(min(least.x, there), max(least.x, min(least.y, there)), max(least.y, min(least.z, there)));
    }
    return reach == 0 ? least.x : reach == 1 ? least.y : least.z;
}

void add_span(uvec3 run, uint bottom) {
    uvec2 codes = uvec2(run.x, bottom);
    if (WIDE) {
        pool_store(derived, span, codes.x);
        pool_store(derived, span + 1u, codes.y);
    } else pool_store(derived, span, codes.x | codes.y << 16u);
    pool_store(derived, span + 1u + IS_WIDE, shows_of(run));
    span += span_words(form);
    highest = max(highest, codes.x);
    lowest = min(lowest, codes.y);
}

// Adds the spans of a column of the block, stores what its solid part shows, and gives that part's code in x, in y how many
// spans there are. Its further spans lie from `at` to `end`.
uvec2 stack_of(uint column, ivec2 place_in_section, uint at, uint end, uint to) {
    uint spans = 0u, around = 0u;
    uvec4 next = first_span(column);
    bool is_around_known = false;
    while (next.x != 0u) {
        if (ALL || shown(next.xyz)) {
            uint class_ = class_of(next.xyz), lowest = lowest_of(next);
            bool floats = always_floats(class_);
            if (!floats && !is_always_solid(class_)) {
                if (!is_around_known) around = lowest_around(place_in_section, reach);
                is_around_known = true;
                floats = lowest > gap && around < lowest - gap;
            }
            if (!floats) break;
            add_span(next.xyz, lowest - min(thickness, lowest - 1u));
            spans++;
        }
        next = uvec4(0u);
        if (at < end) next = span_at(at);
        at += STACK_RUN;
    }
    pool_store(derived, to, shows_of_solid(next, at, end));
    return uvec2(next.x, spans);
}

void main() {
    uint job = gl_WorkGroupID.y, half_block = gl_GlobalInvocationID.x, upper = half_block & 1u;
    uvec4 section = JOB[job].section;
    begin_stacks(job);
    reach = int(JOB[job].reach);
    block = place_of(half_block, 0u);
    if (block == 0u) return;
    uint number = place_of(half_block, 4u + upper);
    if (number == 0u) return;
    counts = section.z + blocks_before(block) * COUNT_WORDS + upper * 8u;
    uint before = place_of(half_block, 1u);
    for (uint w = 0u; w < upper * 8u; w++) before += sum_of_bytes(pool_load(place, counts - 8u + w));
    uint first_of_all = lists_at(form) + 2u * JOB[job].lists * list_words(form);
    span = first_of_all + place_of(half_block, 2u + upper) * span_words(form);
    uint west = western_block(half_block), measured = 0u;
    uvec2 origin = half_block_origin(half_block);

    for (uint side = 0u; side < 2u; side++) {
        uint list = list_at(number, side), first = west + side * block_words(form);
        uint other = section.w + STACK_RUN * before, rows = 0u;
        highest_of_all = 0u;
        pool_store(derived, first + STACK_SPANS, span);
        // A word of counts is a row of one of the two derived blocks.
        for (uint w = 0u; w < 8u; w++) {
            uint others = pool_load(place, counts + w);
            if ((w & 1u) != side) {
                other += STACK_RUN * sum_of_bytes(others);
                continue;
            }
            uint row = w >> 1u, counted = 0u;
            for (uint two = 0u; two < 2u; two++) {
                uvec2 codes = uvec2(0u);
                for (uint k = 0u; k < 2u; k++) {
                    highest = 0u;
                    lowest = NO_BOTTOM;
                    uint x = two * 2u + k, end = other + STACK_RUN * (others >> 8u * x & 0xFFu);
                    uint to = first + shown_in_block(form) + row * 4u + x;
                    uvec2 stack = stack_of(upper * 32u + w * 4u + x, ivec2(origin) + ivec2(side * 4u + x, row), other, end, to);
                    other = end;
                    codes[k] = stack.x;
                    pool_store(derived, first + row * 4u + x, word_of(max(stack.x, highest), stack.x, lowest));
                    highest_of_all = max(highest_of_all, highest);
                    counted |= stack.y << 8u * x;
                    measured |= (stack.x != 0u ? 1u : 0u) << row * 8u + side * 4u + x;
                }
                store_two(derived, codes_at(list, OF_SOLID, form), row * 4u + two * 2u, codes);
            }
            pool_store(derived, list + LIST_COUNTS + row, counted);
            if (row < 3u) rows += sum_of_bytes(counted) << (row == 0u ? 0u : row == 1u ? LIST_ROWS_2 : LIST_ROWS_3);
            if (row == 0u) rows += sum_of_bytes(counted) << LIST_ROWS_2;
        }
        pool_store(derived, list + LIST_ROWS, rows);
        pool_store(derived, list + LIST_TOP, highest_of_all);
    }
    pool_store(derived, west + measured_in_block(form), measured);
    if (!BRIDGE) store_levels_1_and_2(derived, half_block, west);
}
