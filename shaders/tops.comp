// Picks each column's top under the mask: its highest run of a visible class.
// Reads counts, block offsets, heights and attributes; writes what columns show, the measured bits and level 0 of the
// pyramid; without bridges, levels 1 and 2 too.
// One thread a half block; y is the job.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "derive.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 1) const bool ALL = false;    // every run of the sections is shown
layout(constant_id = 2) const bool BRIDGE = false; // bridge.comp follows

uvec2 place, derived;
uint attributes, run, next;
bool values;
uint measured = 0u;
uvec4 visible_low, visible_high;
bool show_withheld;

bool shown(uint r) {
    uint class_ = pool_load(place, attributes + 2u * r) >> 24u;
    uvec4 some = class_ < 128u ? visible_low : visible_high;
    uvec2 pair = (class_ & 64u) == 0u ? some.xy : some.zw;
    uint word = (class_ & 32u) == 0u ? pair.x : pair.y;
    bool withheld = (pool_load(place, attributes + 2u * r + 1u) & FLAG_WITHHELD) != 0u;
    return (word >> (class_ & 31u) & 1u) != 0u && (show_withheld || !withheld);
}

// Stores what the next column shows, gives its top's code.
uint next_column(uint count) {
    uint top = run;
    bool any = count != 0u;
    if (!ALL) {
        any = false;
        for (uint r = run; r < run + count; r++) {
            if (shown(r)) {
                top = r;
                any = true;
                break;
            }
        }
    }
    run += count;
    measured = measured >> 1u | (any ? 0x80000000u : 0u);
    uint code = 0u, shows = 0u;
    if (any) {
        code = load_code(place, HEIGHTS, top, WIDE);
        uint first = pool_load(place, attributes + 2u * top), second = pool_load(place, attributes + 2u * top + 1u);
        shows = first & 0xFF000000u;
        shows |= values ? first >> 8u & 0xFFFFu | (second >> 8u & 0xFFu) << 16u
                        : first & 0xFFu | second >> 24u << 8u | second & 0xFF0000u;
    }
    pool_store(derived, next++, shows);
    return code;
}

// The same for four columns, whose first has its word at `at`.
uvec4 next_four(uint word, uint at) {
    next = at;
    uint counts = pool_load(place, COUNTS + word);
    uvec4 codes;
    codes.x = next_column(counts & 0xFFu);
    codes.y = next_column(counts >> 8u & 0xFFu);
    codes.z = next_column(counts >> 16u & 0xFFu);
    codes.w = next_column(counts >> 24u);
    return codes;
}

void main() {
    uint job = gl_WorkGroupID.y, half_block = gl_GlobalInvocationID.x;
    uvec4 section = JOB[job].section;
    place = section.xy;
    derived = JOB[job].near[4].xy;
    attributes = HEIGHTS + (WIDE ? section.z : (section.z + 1u) / 2u);
    values = DERIVE.values != 0u;
    if (!ALL) {
        visible_low = uvec4(DERIVE.visible[0], DERIVE.visible[1], DERIVE.visible[2], DERIVE.visible[3]);
        visible_high = uvec4(DERIVE.visible[4], DERIVE.visible[5], DERIVE.visible[6], DERIVE.visible[7]);
        // Withheld points are shown as the others, or not at all.
        uint any_withheld = 0u;
        for (int w = 0; w < 8; w++) any_withheld |= DERIVE.visible_withheld[w];
        show_withheld = any_withheld != 0u;
    }

    // The first run: the block's, plus the counts of the half before.
    run = pool_load(place, BLOCKS + half_block / 2u);
    if ((half_block & 1u) != 0u) {
        uint pairs = 0u;
        for (uint w = 0u; w < 8u; w++) {
            uint four = pool_load(place, COUNTS + (half_block - 1u) * 8u + w);
            pairs += (four & 0x00FF00FFu) + (four >> 8u & 0x00FF00FFu);
        }
        run += (pairs & 0xFFFFu) + (pairs >> 16u);
    }

    uint west = western_block(half_block, IS_WIDE), east = west + block_words(IS_WIDE);
    uvec2 level_2 = uvec2(0u);
    uint word = half_block * 8u;
    for (uint pair = 0u; pair < 2u; pair++) {
        uint row = pair * 8u;
        uvec4 south_west = next_four(word, west + shown_in_block(IS_WIDE) + row), south_east = next_four(word + 1u, east + shown_in_block(IS_WIDE) + row);
        store_four(derived, west, row, south_west);
        store_four(derived, east, row, south_east);
        row += 4u;
        uvec4 north_west = next_four(word + 2u, west + shown_in_block(IS_WIDE) + row), north_east = next_four(word + 3u, east + shown_in_block(IS_WIDE) + row);
        store_four(derived, west, row, north_west);
        store_four(derived, east, row, north_east);
        if (!BRIDGE) {
            level_2.x = max(level_2.x, store_level_1(derived, west, pair, south_west, north_west));
            level_2.y = max(level_2.y, store_level_1(derived, east, pair, south_east, north_east));
        }
        word += 4u;
    }
    pool_store(derived, west + measured_in_block(IS_WIDE), measured);
    if (!BRIDGE) store_level_2(derived, half_block, level_2);
}
