// Where what floats is in what is derived of a section, behind the pyramid and only where something may float: the places of the blocks'
// lists, mean heights of what is solid in the nodes of levels 2 to 4, lists, spans.
// Needs pool.glsl, section.glsl. Words count from the start of what is derived; `wide`: 1 where codes are wide.

#ifndef FLOATS_GLSL
#define FLOATS_GLSL
uint floats_at(uint wide) { return upper_levels(wide) + (UPPER_CODES >> 1u - wide) + 15u & ~15u; }
uint list_words(uint wide) { return wide != 0u ? LIST_WORDS_WIDE : LIST_WORDS; }
uint span_words(uint wide) { return wide != 0u ? SPAN_WORDS_WIDE : SPAN_WORDS; }
// First of the lists, and of the spans.
uint lists_at(uint wide) { return floats_at(wide) + FLOAT_WORDS; }

// Two codes, a word, or two where they are wide: top and bottom of a span; highest of what is solid and lowest bottom of what floats of a
// block.
uvec2 two_codes(uvec2 place, uint at, uint wide) {
    uint word = pool_load(place, at);
    if (wide != 0u) return uvec2(word, pool_load(place, at + 1u));
    return uvec2(word & MOST_NARROW_CODE, word >> 16u);
}

// What a block has as the bottom of what floats where nothing does.
uint no_bottom(uint wide) { return wide != 0u ? 0xFFFFFFFFu : MOST_NARROW_CODE; }

// Place of the list of a derived block; 0: nothing floats there.
uint list_of(uvec2 place, uint block, uint wide) { return pool_load(place, floats_at(wide) + FLOAT_LISTS + block); }

// Place of the mean of a node of levels 2 to 4.
uint mean_at(uint level, uvec2 node, uint wide) {
    return floats_at(wide) + FLOAT_MEANS + upper_level(level) + (node.y << SECTION_LOG2 - level | node.x);
}

uint sum_of_bytes(uint four) {
    uint pairs = (four & 0x00FF00FFu) + (four >> 8u & 0x00FF00FFu);
    return (pairs & 0xFFFFu) + (pairs >> 16u);
}

// Codes of the columns of a block, by what they are: where the first lies, and that of column `inner`.
const uint OF_SOLID = 0u;
const uint OF_LOWEST = 1u;
uint codes_at(uint list, uint what, uint wide) { return list + 1u + wide + LIST_SOLID + what * (LIST_CODES << wide); }
uint code_in(uvec2 place, uint list, uint what, uint inner, uint wide) {
    uint word = pool_load(place, codes_at(list, what, wide) + (inner >> 1u - wide));
    return wide != 0u ? word : word >> (inner & 1u) * 16u & MOST_NARROW_CODE;
}

// Code of what is solid of a column of a section in which things may float.
uint solid_code(uvec2 place, uvec2 column, uint wide) {
    uint list = list_of(place, block_of(column), wide);
    return list != 0u ? code_in(place, list, OF_SOLID, in_block(column), wide) : pyramid_code(place, 0u, column, wide);
}

// Spans of a block: where they start.
uint spans_of(uvec2 place, uint list, uint wide) { return pool_load(place, list + 1u + wide + LIST_SPANS); }

// Of column `inner` of a block: the first of its spans among those of the block, and how many it has.
uvec2 spans_of_column(uvec2 place, uint list, uint inner, uint wide) {
    uint row = inner >> 2u, from = list + 1u + wide;
    uint rows = pool_load(place, from + LIST_ROWS), word = pool_load(place, from + LIST_COUNTS + row);
    uint second = rows & (1u << LIST_ROWS_2) - 1u, third = rows >> LIST_ROWS_2 & (1u << LIST_ROWS_3 - LIST_ROWS_2) - 1u;
    uint first = row == 0u ? 0u : row == 1u ? second : row == 2u ? third : third + (rows >> LIST_ROWS_3);
    uint shift = (inner & 3u) * 8u;
    return uvec2(first + sum_of_bytes(word & (1u << shift) - 1u), word >> shift & 0xFFu);
}

// Code of the highest thing that floats in a column; 0: nothing does.
uint floating_top(uvec2 place, uint list, uint inner, uint wide) {
    uvec2 spans = spans_of_column(place, list, inner, wide);
    if (spans.y == 0u) return 0u;
    // The highest come first.
    return two_codes(place, spans_of(place, list, wide) + spans.x * span_words(wide), wide).x;
}

#endif
