// The pre-pass: how far all rays of a tile of the image are sure to be above everything, and near which level
// of nodes they then are. One thread a tile.
//
// Through any pixel of the tile and any s, origin + s · direction lies between those of the tile's four corner rays
// (both are affine in the pixel), so a box around the four holds all rays. The beam goes on as long as the box,
// over a stretch of s, lies in 2x2 nodes of one level that are all below its lowest corner; it takes a coarser level
// after each stretch, and a finer one where that fails, until the nodes would be smaller than the box.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "lookup.glsl"

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;
// Pixels of a tile's side, and of the tile's whose beam this one goes on from (0: none).
layout(constant_id = ID_SIDE) const uint SIDE = TILE;
layout(constant_id = ID_BEFORE) const uint BEFORE = 0u;

const float NOTHING = -3e38;

// Highest thing in node `index` of `level`; NOTHING where there is none.
float top_of(inout Here here, inout Section section, int level, ivec2 index) {
    if (here.slot == NO_NODE || level >= here.level || !is_in(here, level, index)) {
        int at;
        uint top;
        here.slot = find_around(level, index, at, top);
        if (here.slot == NO_NODE) return NOTHING;
        if (at == level) {
            here.slot = NO_NODE;
            return uintBitsToFloat(top);
        }
        here.node = index >> at - level;
        here.level = at;
        section = section_in(here.slot, detail_of(here.slot));
    }
    uint code = code_at(section, level, index);
    return code == 0u ? NOTHING : float(height_of(section, code));
}

float min4(vec4 v) { return min(min(v.x, v.y), min(v.z, v.w)); }
float max4(vec4 v) { return max(max(v.x, v.y), max(v.z, v.w)); }

void main() {
    uvec2 tile = dealt_tile(gl_WorkGroupSize);
    uvec2 tiles = (uvec2(frame.width, push.rows) + SIDE - 1u) / SIDE;
    if (any(greaterThanEqual(tile, tiles))) return;
#ifdef LOGGED
    log_begin(frame.colors, tile.y * tiles.x + tile.x);
#endif

    // The corner rays: origin from the first one's cell, direction a unit of depth.
    vec4 ox, oy, oz, dx, dy, dz;
    ivec3 from;
    for (int corner = 0; corner < 4; corner++) {
        ivec2 steps = from_middle((tile + uvec2(corner & 1, corner >> 1)) * SIDE);
        ivec3 cell;
        vec3 fraction, direction;
        origin_at(frame.origin_int, frame.origin_fraction, steps, steps * 16 - odd_half(), cell, fraction, direction);
        if (corner == 0) from = cell;
        vec3 origin = vec3(cell - from) + fraction;
        origin.z *= frame.origin_step;
        direction *= frame.to_local;
        ox[corner] = origin.x; oy[corner] = origin.y; oz[corner] = origin.z;
        dx[corner] = direction.x; dy[corner] = direction.y; dz[corner] = direction.z;
    }
    vec4 ix = 1.0 / mix(dx, vec4(1e-20), lessThan(abs(dx), vec4(1e-20)));
    vec4 iy = 1.0 / mix(dy, vec4(1e-20), lessThan(abs(dy), vec4(1e-20)));
    ivec2 low = frame.low - from.xy, high = frame.high - from.xy;
    float base_z = float(from.z) * frame.origin_step;
    bvec2 ahead = bvec2(dx.x + dx.w >= 0.0, dy.x + dy.w >= 0.0);

    float s = -frame.depth;
    int level = frame.top_level;
    if (BEFORE > 0u) {
        uvec2 before = tile * SIDE / BEFORE;
        uint wide_tile = before.y * ((frame.width + BEFORE - 1u) / BEFORE) + before.x;
        log_load(frame.wide_beams, wide_tile);
        uint start = WIDE_BEAM[wide_tile];
        s = beam_depth(start);
        level = beam_level(start);
    }

    Here here;
    here.slot = NO_NODE;
    Section section;
    bool gone = s > FAR;
    for (int step = 0; step < 96 && !gone; step++) {
        log_step();
        vec4 x = fma(vec4(s), dx, ox), y = fma(vec4(s), dy, oy), z = fma(vec4(s), dz, oz);
        vec2 lo = vec2(min4(x), min4(y)), hi = vec2(max4(x), max4(y));
        // Rounding of places and heights, generously.
        vec2 slack = 0.03 + 5e-7 * max(abs(lo), abs(hi));
        lo -= slack;
        hi += slack;
        float size = float(1 << level);
        vec2 box = hi - lo;
        if (max(box.x, box.y) >= size) {
            if (level >= 20) break;
            // The box has outgrown the nodes.
            level++;
            if (max(box.x, box.y) >= 2.0 * size) continue;
            size *= 2.0;
        }
        // 2x2 nodes, the beam entering them.
        ivec2 near = ivec2(floor(mix(hi, lo, ahead))) + from.xy >> level;
        ivec2 first = near - ivec2(not(ahead));
        ivec2 corner_low = (first << level) - from.xy, corner_high = (first + 2 << level) - from.xy;
        vec4 sx = (mix(vec4(corner_low.x + slack.x), vec4(corner_high.x - slack.x), greaterThan(dx, vec4(0.0))) - ox) * ix;
        vec4 sy = (mix(vec4(corner_low.y + slack.y), vec4(corner_high.y - slack.y), greaterThan(dy, vec4(0.0))) - oy) * iy;
        float s_exit = min(min4(sx), min4(sy));
        if (!(s_exit > s)) {
            // Not even the box itself lies in them, slack included.
            if (level >= 20) break;
            level++;
            continue;
        }
        vec4 z_exit = fma(vec4(s_exit), dz, oz);
        float lowest = min(min4(z), min4(z_exit));
        lowest += base_z - 1.0 - 1e-6 * (abs(lowest) + abs(base_z));

        bool outside = any(greaterThanEqual(corner_low, high)) || any(lessThanEqual(corner_high, low));
        bool clear = outside;
        if (!outside && level <= frame.top_level) {
            float top = max(max(top_of(here, section, level, first), top_of(here, section, level, first + ivec2(1, 0))),
                            max(top_of(here, section, level, first + ivec2(0, 1)), top_of(here, section, level, first + ivec2(1, 1))));
            clear = lowest > top;
        }
        if (clear) {
            // Away from everything: no corner comes back.
            gone = lo.x >= float(high.x) && min4(dx) >= 0.0 || hi.x <= float(low.x) && max4(dx) <= 0.0
                || lo.y >= float(high.y) && min4(dy) >= 0.0 || hi.y <= float(low.y) && max4(dy) <= 0.0;
            s = s_exit;
            level = min(level + 1, 20);
        } else {
            if (level == 0 || max(box.x, box.y) >= 0.5 * size) break;
            level--;
        }
    }
    if (gone) s = 2.0 * FAR;
    uint reached = beam_of(s, level);
    uint at = tile.y * tiles.x + tile.x;
    if (BEFORE > 0u) BEAM[at] = reached;
    else WIDE_BEAM[at] = reached;
#ifdef LOGGED
    log_end();
#endif
}
