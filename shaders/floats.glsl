// Where what floats is in what is derived of a section in which something may: words of nodes and the places of lists in its blocks,
// and behind the pyramid mean heights of what is solid in the nodes of levels 2 to 4, lists, spans.
// Needs pool.glsl, section.glsl. Words count from the start of what is derived; `form`: of a section, with FORM_FLOATS.

#ifndef FLOATS_GLSL
#define FLOATS_GLSL
const uint STACK_WORDS = STACK_SHOWN + SHOWN_WORDS;

uint floats_at(uint form) { return upper_levels(form) + (UPPER_CODES >> 1u - wide_of(form)) + 15u & ~15u; }
uint list_words(uint form) { return wide_of(form) != 0u ? LIST_WORDS_WIDE : LIST_WORDS; }
uint span_words(uint form) { return wide_of(form) != 0u ? SPAN_WORDS_WIDE : SPAN_WORDS; }
// First of the lists, and of the spans.
uint lists_at(uint form) { return floats_at(form) + FLOAT_WORDS; }

// Two codes, a word, or two where they are wide: top and bottom of a span.
uvec2 two_codes(uvec2 place, uint at, uint form) {
    uint word = pool_load(place, at);
    if (wide_of(form) != 0u) return uvec2(word, pool_load(place, at + 1u));
    return uvec2(word & MOST_NARROW_CODE, word >> 16u);
}

// How far below its code a node's word says that the highest thing that is solid is, at least, and the lowest bottom of what floats,
// at most (STACK_MOST_BELOW: or more). Wide codes leave no room for that: nothing is known.
uvec2 below_code(uint word) { return uvec2(word >> STACK_SOLID_SHIFT & STACK_MOST_BELOW, word >> STACK_BOTTOM_SHIFT); }

// Place of the list of a derived block; 0: nothing floats there, whatever is shown.
uint list_of(uvec2 place, uint block) { return pool_load(place, block * STACK_WORDS + STACK_LIST); }

// Place of the mean of a node of levels 2 to 4.
uint mean_at(uint level, uvec2 node, uint form) {
    return floats_at(form) + FLOAT_MEANS + upper_level(level) + (node.y << SECTION_LOG2 - level | node.x);
}

uint sum_of_bytes(uint four) {
    uint pairs = (four & 0x00FF00FFu) + (four >> 8u & 0x00FF00FFu);
    return (pairs & 0xFFFFu) + (pairs >> 16u);
}

// Codes of the columns of a block, by what they are: where the first lies, and that of column `inner`.
const uint OF_SOLID = 0u;
const uint OF_LOWEST = 1u;
uint codes_at(uint list, uint what, uint form) { return list + LIST_SOLID + what * (LIST_CODES << wide_of(form)); }
uint code_in(uvec2 place, uint list, uint what, uint inner, uint form) {
    uint word = pool_load(place, codes_at(list, what, form) + (inner >> 1u - wide_of(form)));
    return wide_of(form) != 0u ? word : word >> (inner & 1u) * 16u & MOST_NARROW_CODE;
}

// Code of what is solid of a column of any section.
uint solid_code(uvec2 place, uvec2 column, uint form) {
    uint list = floats_of(form) != 0u ? list_of(place, block_of(column)) : 0u;
    return list != 0u ? code_in(place, list, OF_SOLID, in_block(column), form) : pyramid_code(place, 0u, column, form);
}

// Spans of a block that has a list: where they start.
uint spans_of(uvec2 place, uint block) { return pool_load(place, block * STACK_WORDS + STACK_SPANS); }

// Of column `inner` of a block: the first of its spans among those of the block, and how many it has.
uvec2 spans_of_column(uvec2 place, uint list, uint inner) {
    uint row = inner >> 2u;
    uint rows = pool_load(place, list + LIST_ROWS), word = pool_load(place, list + LIST_COUNTS + row);
    uint second = rows & (1u << LIST_ROWS_2) - 1u, third = rows >> LIST_ROWS_2 & (1u << LIST_ROWS_3 - LIST_ROWS_2) - 1u;
    uint first = row == 0u ? 0u : row == 1u ? second : row == 2u ? third : third + (rows >> LIST_ROWS_3);
    uint shift = (inner & 3u) * 8u;
    return uvec2(first + sum_of_bytes(word & (1u << shift) - 1u), word >> shift & 0xFFu);
}

// Code of the lowest bottom where nothing floats.
const uint NO_BOTTOM = 0xFFFFFFFFu;

// Codes of the highest top and the lowest bottom of what floats in a column of a block that has a list; 0 and NO_BOTTOM: nothing does.
uvec2 floating_ends(uvec2 place, uint block, uint list, uint inner, uint form) {
    uvec2 spans = spans_of_column(place, list, inner), ends = uvec2(0u, NO_BOTTOM);
    for (uint k = 0u; k < spans.y; k++) {
        uvec2 span = two_codes(place, spans_of(place, block) + (spans.x + k) * span_words(form), form);
        ends = uvec2(max(ends.x, span.x), min(ends.y, span.y));
    }
    return ends;
}

#endif
