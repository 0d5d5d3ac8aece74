// What is seen of a column.
// Needs pool.glsl, section.glsl, frame.glsl.

vec3 linear_of(vec3 srgb) { return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), greaterThan(srgb, vec3(0.04045))); }

vec3 bytes(uint packed_bytes) { return vec3(packed_bytes & 0xFFu, packed_bytes >> SHOWN_GREEN_SHIFT & 0xFFu, packed_bytes >> SHOWN_BLUE_SHIFT & 0xFFu) / 255.0; }

// Whether colours are not RGB: a specialisation constant, so that the pipeline does only what it must.
layout(constant_id = ID_RAMPED) const bool RAMPED = true;

// What a column shows (see section.glsl).
uint shown_at(uint slot, uvec2 column) {
    return shown_of(node_pyramid(slot), column, node_form(slot));
}

#ifdef STACKED
#include "floats.glsl"

// The same of one of the spans of its block, from 1 on; 0: of its solid part.
uint shown_at(uint slot, uvec2 column, uint span) {
    uvec2 place = node_pyramid(slot);
    uint form = node_form(slot);
    if (span == 0u) return shown_of(place, column, form);
    return pool_load(place, spans_of(place, block_of(column)) + span * span_words(form) - 1u);
}
#endif

uint class_of(uint shows) { return shows >> SHOWN_CLASS_SHIFT; }

// Of what has no value.
const vec3 UNKNOWN = vec3(0.65);

// Entry of a palette of numbers whose high byte counts `counted`.
uint palette_entry(uint value, uint counted) { return value + counted * (value >> 8u) & 255u; }

// Its colour, sRGB; `top` is the column's, lattice steps from the anchor.
vec3 srgb_of(uint shows, uint top) {
    if (!RAMPED || frame.color_source == COLOR_RGB) return bytes(shows);
    if (frame.color_source == COLOR_PALETTE) return RAMP[palette_entry(shows & 0xFFFFu, frame.range_low)].rgb;
    uint value = frame.color_source == COLOR_HEIGHT ? (top + uint(frame.height_anchor)) ^ HEIGHT_SIGN
               : frame.color_source == COLOR_CLASS ? class_of(shows)
               : frame.color_source == COLOR_CHANNEL || frame.color_source == COLOR_KNOWN ? shows & 0xFFFFu
               : shows >> SHOWN_RETURNS_SHIFT & 0xFFu;
    if (frame.color_source == COLOR_KNOWN && value == 0u) return UNKNOWN;
    float beyond = value > frame.range_low ? float(value - frame.range_low) : 0.0;
    float at_entry = clamp(beyond * frame.range_scale + frame.range_offset, 0.0, float(RAMP_ENTRIES - 1u));
    int entry = int(at_entry);
    return mix(RAMP[entry].rgb, RAMP[min(entry + 1, int(RAMP_ENTRIES) - 1)].rgb, at_entry - float(entry));
}

// Second word of a finished hit record; `span`: a span was hit, which is measured always.
uint bits_of(uint shows, uint slot, uvec2 column, uint face, bool span) {
    bool measured = span || is_measured(node_pyramid(slot), column, node_form(slot));
    uint meta = node_meta(slot), detail = meta >> META_DETAIL_SHIFT;
    // What stands in reaches farther than the node that shows it.
    uint stands_in = detail + SECTION_LOG2 > (meta & META_LEVEL_MASK) ? BITS_STANDS_IN : 0u;
    return class_of(shows) | (measured ? ORIGIN_MEASURED : ORIGIN_BRIDGED) << BITS_ORIGIN_SHIFT | face << BITS_FACE_SHIFT
         | detail << BITS_DETAIL_SHIFT | stands_in;
}

// Third word of a finished hit record.
uint rest_of(uint steps, uint shows) {
    bool by_channel = RAMPED && (frame.color_source == COLOR_CHANNEL || frame.color_source == COLOR_PALETTE || frame.color_source == COLOR_KNOWN);
    return min(steps, MOST_STEPS) | (by_channel ? shows << HIT_VALUE_SHIFT : 0u);
}

vec3 sky(vec3 direction) {
    // A bright haze at the horizon, soft blue above, quiet grey below.
    float up = direction.z;
    vec3 away = up >= 0.0 ? vec3(0.30, 0.49, 0.76) : vec3(0.62, 0.67, 0.72);
    return mix(vec3(0.82, 0.87, 0.92), away, smoothstep(0.0, 0.75, abs(up)));
}

// What is behind the data, linear.
vec4 background(vec3 direction) {
    vec4 color = vec4(frame.background == BACKGROUND_WHITE ? vec3(1.0) : vec3(0.0), frame.background == BACKGROUND_NONE ? 0.0 : 1.0);
    if (frame.background == BACKGROUND_SKY) color = vec4(linear_of(sky(direction)), 1.0);
    return color;
}
