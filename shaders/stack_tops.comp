// Of stacks: in half blocks where nothing may float, each column's top, as tops.comp; in the others the lowest of the points that
// are shown in each column, from which floaters.comp tells what floats.
// Reads spans; writes what columns show, the measured bits and level 0 of the pyramid, without bridges levels 1 and 2; the places
// of lists, and lowest points. One thread a half block; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"
#include "runs.glsl"
#include "stacks.glsl"

layout(local_size_x = DERIVE_THREADS) in;
layout(constant_id = ID_BRIDGE) const bool BRIDGE = false; // bridge.comp follows

uint column, other;
uint measured = 0u;

// Stores what the next column shows, gives its top's code; `others` is how many further spans it has.
uint next_top(uint others, uint to) {
    uvec4 top = first_span(column++);
    uint end = other + STACK_RUN * others;
    while (top.x != 0u && !ALL && !shown(top.xyz)) {
        top = other < end ? span_at(other) : uvec4(0u);
        other += STACK_RUN;
    }
    pool_store(derived, to, shows_of_solid(top, other, end));
    other = end;
    measured = measured >> 1u | (top.x != 0u ? 0x80000000u : 0u);
    return top.x;
}

// Code of the next column's lowest point; 0: it has none.
uint next_lowest(uint others) {
    uvec4 span = first_span(column++);
    uint lowest = 0xFFFFFFFFu, end = other + STACK_RUN * others;
    while (span.x != 0u) {
        if (ALL || shown(span.xyz)) lowest = min(lowest, lowest_of(span));
        span = uvec4(0u);
        if (other < end) span = span_at(other);
        other += STACK_RUN;
    }
    other = end;
    return lowest != 0xFFFFFFFFu ? lowest : 0u;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block = gl_GlobalInvocationID.x, upper = half_block & 1u;
    uvec4 section = JOB[job].section;
    begin_stacks(job);

    block = place_of(half_block, 0u);
    counts = section.z + blocks_before(block) * COUNT_WORDS;
    uint west = western_block(half_block), number = block != 0u ? place_of(half_block, 4u + upper) : 0u;
    if (floats_of(form) != 0u)
        for (uint side = 0u; side < 2u; side++)
            pool_store(derived, west + side * block_words(form) + STACK_LIST, number != 0u ? list_at(number, side) : 0u);
    column = upper * 32u;
    uint before = 0u;
    if (block != 0u) {
        before = place_of(half_block, 1u);
        for (uint w = 0u; w < column / 4u; w++) before += sum_of_bytes(pool_load(place, counts + w));
    }
    other = section.w + STACK_RUN * before;
    // Two at a time, of one word where codes are narrow.
    for (uint two = 0u; two < 16u; two++) {
        uint side = two >> 1u & 1u, inner = (two >> 2u) * 4u + (two & 1u) * 2u;
        uint first = west + side * block_words(form), to = first + shown_in_block(form) + inner;
        uvec2 codes = uvec2(0u);
        if (block == 0u) {
            pool_store(derived, to, 0u);
            pool_store(derived, to + 1u, 0u);
        } else {
            uint others = pool_load(place, counts + (column >> 2u)) >> (two & 1u) * 16u;
            if (number == 0u) {
                codes.x = next_top(others & 0xFFu, to);
                codes.y = next_top(others >> 8u & 0xFFu, to + 1u);
            } else {
                codes.x = next_lowest(others & 0xFFu);
                codes.y = next_lowest(others >> 8u & 0xFFu);
            }
        }
        if (number == 0u) store_tops(derived, first, inner, codes);
        else store_two(derived, codes_at(list_at(number, side), OF_LOWEST, form), inner, codes);
    }
    if (number != 0u) return;
    pool_store(derived, west + measured_in_block(form), measured);
    if (!BRIDGE) store_levels_1_and_2(derived, half_block, west);
}
