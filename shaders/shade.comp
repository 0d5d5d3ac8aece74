// Colour of each pixel's hit: attribute to colour, light, sum over samples; leaves the channels of an exact
// image in the hit record. Reads hit records, the table, payloads and the ramp; adds to the colour sums.
//
// Light: a sun from the north-west as on maps, a sky dimmed by what stands around (its horizon in eight
// directions), sides by their own direction, tops by the slope that fits their neighbours, gentle ones exaggerated as
// in hillshades. Below the ground there is a plain slab, and nothing below that.
#version 460
#extension GL_GOOGLE_include_directive : require
#define FRAME_STORED
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "lookup.glsl"
#include "color.glsl"
#ifdef SMOOTH
#include "corners.glsl"
#include "joins.glsl"
#include "tubes.glsl"
#endif

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;

// Goes to the node that shows something at `column` (cells of `detail`); `shown`: the detail of what that is.
void go_to(inout Here here, inout int shown, int detail, ivec2 column) {
    if (is_in(here, detail, column)) return;
    here.node = column >> here.level - detail;
    here.slot = find_node(uint(here.level), here.node);
    shown = detail;
    if (here.slot != NO_NODE && is_section(node_top(here.slot)) && detail_of(here.slot) == detail) return;
    // Another size or detail begins here.
    int at;
    uint top;
    here.slot = find_around(detail, column, at, top);
    // Smaller ones are looked up for each column.
    if (at < here.level) here.node = ivec2(0x7FFFFFFF);
    if (here.slot == NO_NODE) return;
    if (is_section(top)) shown = detail_of(here.slot);
    else here.slot = NO_NODE;
}

#ifdef STACKED
// Whether what floats counts for tops; and whether the hit is of that.
bool over = false, of_span = false;
#endif

// Top of `column` (cells of `detail`), lattice steps from the anchor; false where there is none.
bool top_at(inout Here here, inout int shown, int detail, ivec2 column, out float top) {
    go_to(here, shown, detail, column);
    if (here.slot == NO_NODE) return false;
    Section section = section_in(here.slot, shown);
    uint code = code_at(section, detail, column);
#ifdef STACKED
    // Of what floats, too, where that is looked at.
    if (!over && code != 0u && detail <= shown && node_floats(here.slot) != 0u) {
        uvec2 inner = uvec2(column >> shown - detail) & (SECTION_SIDE - 1u);
        uint list = list_of(section.pyramid, block_of(inner));
        if (list != 0u) code = code_in(section.pyramid, list, OF_SOLID, in_block(inner), section.form);
    }
#endif
    top = float(height_of(section, code));
    return code != 0u;
}

// Slope of the surface around a column (steps up per cell east and north): least squares over the 24 columns
// around, those on another surface (a roof beside a street) counting little.
vec2 slope_at(inout Here here, inout int shown, int detail, ivec2 column, float top, float cell_steps) {
    // Normal equations of h = a x + b y through the column's own top.
    float xx = 0.05, xy = 0.0, yy = 0.05;
    vec2 xh = vec2(0.0);
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            float other;
            if ((x == 0 && y == 0) || !top_at(here, shown, detail, column + ivec2(x, y), other)) continue;
            float d2 = float(x * x + y * y);
            float rise = (other - top) / cell_steps;
            float excess = rise * rise / d2; // squared slope
            float weight = 1.0 / (d2 * (1.0 + excess * excess));
            xx += weight * float(x * x);
            xy += weight * float(x * y);
            yy += weight * float(y * y);
            xh += weight * rise * vec2(x, y);
        }
    }
    return vec2(yy * xh.x - xy * xh.y, xx * xh.y - xy * xh.x) / (xx * yy - xy * xy);
}

#ifdef SMOOTH
// Slope of the surface about a place (cells from the middle of a column) at height `z`: least squares over the columns less than two
// cells away, those on another surface counting little. It does not jump from column to column.
vec2 slope_about(inout Here here, inout int shown, int detail, ivec2 column, vec2 place, float z, float cell_steps) {
    float n = 1e-6;
    vec3 squares = vec3(0.0); // xx, xy, yy
    vec3 mean = vec3(0.0);    // x, y, height
    vec2 rises = vec2(0.0);
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            vec2 to = vec2(x, y) - place;
            float d2 = dot(to, to), other;
            if (d2 >= 4.0 || !top_at(here, shown, detail, column + ivec2(x, y), other)) continue;
            float rise = (other - z) / cell_steps;
            float excess = rise * rise / (d2 + 0.5); // squared slope, nearly
            float weight = (1.0 - 0.25 * d2) / (1.0 + excess * excess);
            n += weight;
            mean += weight * vec3(to, rise);
            squares += weight * vec3(to.x * to.x, to.x * to.y, to.y * to.y);
            rises += weight * rise * to;
        }
    }
    squares += vec3(0.05, 0.0, 0.05) - vec3(mean.x * mean.x, mean.x * mean.y, mean.y * mean.y) / n;
    rises -= mean.z * mean.xy / n;
    return vec2(squares.z * rises.x - squares.y * rises.y, squares.x * rises.y - squares.y * rises.x)
         / (squares.x * squares.z - squares.y * squares.y);
}
#endif

#ifdef SMOOTH
// Away from the axis of what is round, span `span` of the block of a column, at a place (cells from the column's middle) at height `z`; 0:
// the span is a slab.
vec3 round_normal_at(uint slot, uvec2 column, uint span, int detail, vec2 place, float z) {
    uvec2 pyramid = node_pyramid(slot);
    uint form = node_form(slot), wide = wide_of(form), block = block_of(column);
    uint from = spans_of(pyramid, block), first = spans_of_column(pyramid, list_of(pyramid, block), in_block(column)).x;
    uint k = span - 1u, at = from + k * span_words(form), class_ = pool_load(pyramid, at + 1u + wide) >> SHOWN_CLASS_SHIFT;
    uvec2 words = joins_at(pyramid, at + node_joins(slot));
    // The highest of what it is a part of.
    while (is_joined_above(words) && k > first) {
        k--;
        uint above = from + k * span_words(form);
        if (pool_load(pyramid, above + 1u + wide) >> SHOWN_CLASS_SHIFT != class_) continue;
        at = above;
        words = joins_at(pyramid, at + node_joins(slot));
    }
    if (is_joined_above(words) || !is_upright(words) && !is_tube(words)) return vec3(0.0);
    ivec2 ends = node_base(slot) + ivec2(two_codes(pyramid, at, form));
    Tube tube = tube_of(words, ends, detail, ivec2(0));
    vec3 away = away_from(tube, vec3(place, (z - float(middle_of(ends))) / (frame.cell_height * float(1 << detail))));
    // As it is shown.
    away.z *= frame.cell_steps / frame.cell_height;
    return dot(away, away) > 0.0 ? normalize(away) : vec3(0.0, 0.0, 1.0);
}
#endif

// Share of the sky seen from height `z` over `column`, in directions with a part along `outward` (0: all); `place`: from where,
// cells from its middle.
float sky_at(inout Here here, inout int shown, int detail, ivec2 column, vec2 place, float z, vec2 outward, float cell_steps) {
    const ivec2 directions[8] = ivec2[](ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1), ivec2(-1, 0), ivec2(-1, -1), ivec2(0, -1), ivec2(1, -1));
    const int reach[5] = int[](1, 2, 4, 7, 12);
    float seen = 0.0, all_ways = 0.0;
    for (int d = 0; d < 8; d++) {
        if (dot(vec2(directions[d]), outward) < 0.0) continue;
        float unit = cell_steps * length(vec2(directions[d]));
        float horizon = 0.0; // tangent
#ifdef SMOOTH
        // What the next column rises by is the surface's slope.
        for (int r = 1; r < 5; r++) {
#else
        for (int r = 0; r < 5; r++) {
#endif
            float other;
#ifdef STACKED
            // Of what floats over what is solid only the nearest dims it: a crown its foot, a wire no swath.
            over = of_span || r < 2;
#endif
            if (top_at(here, shown, detail, column + directions[d] * reach[r], other))
#ifdef SMOOTH
                horizon = max(horizon, (other - z) / (cell_steps * length(vec2(directions[d] * reach[r]) - place)) - 0.08);
#else
                horizon = max(horizon, (other - z) / (unit * float(reach[r])) - 0.08);
#endif
        }
        seen += 1.0 / (1.0 + horizon * horizon); // cosine-weighted: cos² of the horizon's elevation
        all_ways += 1.0;
    }
    return seen / max(all_ways, 1.0);
}

// Height of the ground under a column (cells of `detail`), in rough outline.
float ground_at(int detail, ivec2 column) {
    vec2 from_first = vec2((column << detail) - frame.ground_first) + 0.5 * float(1 << detail);
    vec2 on = clamp(from_first * frame.ground_scale + frame.ground_at, vec2(0.0), vec2(GROUND_SIDE - 1u));
    vec2 first = min(floor(on), vec2(GROUND_SIDE - 2u)), beyond = on - first;
    uint at = uint(first.y) * GROUND_SIDE + uint(first.x);
    return mix(mix(GROUND[at], GROUND[at + 1u], beyond.x), mix(GROUND[at + GROUND_SIDE], GROUND[at + GROUND_SIDE + 1u], beyond.x), beyond.y);
}

#ifdef STACKED
// Of the sky that is seen, what is left beneath something that floats.
const float UNDER_FLOATS = 0.6;

// Whether anything floats above a column.
bool is_under_floats(uint slot, uvec2 column) {
    if (node_floats(slot) == 0u) return false;
    uvec2 place = node_pyramid(slot);
    uint list = list_of(place, block_of(column));
    return list != 0u && spans_of_column(place, list, in_block(column)).y > 0u;
}
#endif

const vec3 SLAB = vec3(0.26, 0.25, 0.235); // linear

void main() {
    uvec2 pixel = dealt_pixel(gl_WorkGroupSize);
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    uint at = pixel.y * frame.width + pixel.x;
    uvec4 hit = HIT[at];
    Ray ray = ray_of(pixel);

    vec4 color = vec4(0.0);
    uint bits = BITS_MISS, seen = 0u;
    bool is_hit = hit.y != NO_NODE;
    if (is_hit) {
        uint meta = node_meta(hit.y);
        int detail = int(meta >> META_DETAIL_SHIFT), level = int(meta & META_LEVEL_MASK);
        uvec2 inner = uvec2(hit.z & SECTION_SIDE - 1u, hit.z >> SECTION_LOG2 & SECTION_SIDE - 1u);
        uint face = hit.z >> HIT_FACE_SHIFT & HIT_FACE_MASK;
        ivec2 column = (index_of(hit.y) >> detail + int(SECTION_LOG2) - level) * int(SECTION_SIDE) + ivec2(inner);
        float top = float(int(hit.w));
        float z = face == FACE_TOP ? top : fma(uintBitsToFloat(hit.x), ray.step.z, origin_height(ray));
        bool is_slab = false, is_span = false;
        uint span = 0u;
#ifdef STACKED
        span = hit.z >> HIT_STEPS_SHIFT;
        is_span = over = of_span = span != 0u;
#endif
        vec2 place = vec2(0.0);
        float edge = top;
        uint ramp_height = hit.w;
#ifdef SMOOTH
        uint corners = node_corners(hit.y);
        if (!is_span && corners != 0u) {
            // Where in its column it is, and how high the surface is there.
            float size = float(1 << detail);
            vec2 in_column = vec2(ray.cell.xy - (column << detail)) + fma(vec2(uintBitsToFloat(hit.x)), ray.step.xy, ray.fraction.xy);
            in_column = clamp(in_column / size, 0.0, 1.0);
            place = in_column - 0.5;
            vec4 four = vec4(node_base(hit.y) + ivec4(corners_of(node_pyramid(hit.y), corners, inner, wide_of(node_form(hit.y)))));
            vec2 ends = mix(four.xz, four.yw, in_column.x);
            edge = mix(ends.x, ends.y, in_column.y);
            if (face == FACE_TOP) {
                z = edge;
                if (frame.shade == SHADE_LIT) ramp_height = uint(int(round(edge)));
            }
        }
        vec3 round_normal = vec3(0.0);
        bool is_joined = is_span && node_joins(hit.y) != 0u;
        if (is_joined) {
            z = fma(uintBitsToFloat(hit.x), ray.step.z, origin_height(ray));
            if (frame.shade == SHADE_LIT) ramp_height = uint(int(round(z)));
            float size = float(1 << detail);
            place = clamp((vec2(ray.cell.xy - (column << detail)) + fma(vec2(uintBitsToFloat(hit.x)), ray.step.xy, ray.fraction.xy)) / size, 0.0, 1.0) - 0.5;
            round_normal = round_normal_at(hit.y, inner, span, detail, place, z);
            is_joined = round_normal == vec3(0.0);
            edge = z;
        }
#endif
        // Columns are solid without end: below the slab a lit image shows what is behind their sides.
        if (frame.shade == SHADE_LIT && face != FACE_TOP && !is_span) {
            float ground = ground_at(detail, column);
            is_slab = z < ground;
            is_hit = z >= min(ground, top) - frame.slab;
        }
        // A column larger than its node is alone.
        Here here = Here(level > detail ? index_of(hit.y) : column, max(level, detail), hit.y);
        int shown = detail;

#ifdef STACKED
        uint shows = shown_at(hit.y, inner, span);
#else
        uint shows = shown_at(hit.y, inner);
#endif
        vec3 albedo = is_slab ? SLAB : linear_of(srgb_of(shows, ramp_height));
        color = vec4(albedo, 1.0);
        if (is_hit) bits = bits_of(shows, hit.y, inner, face, is_span);
        seen = is_hit ? shows : 0u;

        if (frame.shade == SHADE_LIT && is_hit) {
            float cell_steps = frame.cell_steps * float(1 << detail);
            vec2 outward = vec2(0.0);
            vec3 normal;
#ifdef SMOOTH
            vec2 slope = vec2(0.0);
            if (is_joined) slope = slope_about(here, shown, detail, column, place, z, cell_steps);
            else if (is_span || corners == 0u) slope = is_slab ? slope : slope_at(here, shown, detail, column, top, cell_steps);
            else if (!is_slab) slope = slope_about(here, shown, detail, column, place, edge, cell_steps);
#else
            vec2 slope = is_slab ? vec2(0.0) : slope_at(here, shown, detail, column, top, cell_steps);
#endif
            // Gentle slopes by more than twice, so that beds and ruts show; steep ones as they are.
            slope *= 1.0 + 1.3 / (1.0 + 4.0 * dot(slope, slope));
            vec3 up = normalize(vec3(-slope, 1.0));
            if (face == FACE_TOP || face == FACE_INSIDE) {
                normal = up;
            } else if (face == FACE_BOTTOM) {
                normal = vec3(0.0, 0.0, -1.0);
            } else {
                outward = face == FACE_WEST ? vec2(-1, 0) : face == FACE_EAST ? vec2(1, 0) : face == FACE_SOUTH ? vec2(0, -1) : vec2(0, 1);
                // A low step of a slope is part of the slope; a wall is a wall.
                float drop = (edge - z) / cell_steps;
                float wall = smoothstep(0.2, 1.5, drop + 0.6);
#ifdef SMOOTH
                // Beside a surface that is much lower it is one up to the very edge.
                float other;
                bool is_beside = top_at(here, shown, detail, column + ivec2(outward), other);
                if (!is_span && corners != 0u) wall = max(wall, is_beside ? smoothstep(0.5, 1.5, (top - other) / cell_steps) : 1.0);
#endif
                normal = normalize(mix(up, vec3(outward, 0.0), wall));
            }
#ifdef SMOOTH
            if (round_normal != vec3(0.0)) {
                normal = round_normal;
                outward = vec2(0.0);
            }
#endif
            // The slab is one plain band.
            if (is_slab) normal = vec3(outward, 0.0);
            float sky_seen = is_slab ? 1.0 : sky_at(here, shown, detail, column, place, z, outward, cell_steps);
#ifdef STACKED
            // Beneath what floats there is less sky.
            if (!is_span && face == FACE_TOP && is_under_floats(hit.y, inner)) sky_seen *= UNDER_FLOATS;
#endif
            float lit = max(dot(normal, frame.sun), 0.0);
            vec3 sunlight = vec3(1.0, 0.96, 0.88) * 2.00 * lit * mix(0.5, 1.0, sky_seen);
            vec3 skylight = vec3(0.62, 0.70, 0.82) * (0.55 + 0.45 * normal.z) * sky_seen * sky_seen;
            // From the ground: sides, which maps do not show, would be black in the shade.
            float away = min(1.0 - normal.z, 1.0), bounce = 0.02 + 0.20 * away * away;
            vec3 light = sunlight + skylight * 0.28 + bounce;
            // Photographs hold light already.
            if (frame.color_source == COLOR_RGB) light = mix(vec3(1.2), light, 0.6);
            color.rgb = albedo * light;
        }
    }
    if (!is_hit) color = background(ray.world);

    vec4 sum = color * push.sample_weight;
    if (push.sample_index > 0u) sum += COLOR[at];
    COLOR[at] = sum;
#ifdef STACKED
    HIT[at] = uvec4(hit.x, bits, rest_of(0u, seen), hit.w);
#else
    HIT[at] = uvec4(hit.x, bits, rest_of(hit.z >> HIT_STEPS_SHIFT, seen), hit.w);
#endif
}
