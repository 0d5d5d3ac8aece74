// Traces one ray a pixel and gives it its column's very colour: the whole of an exact picture in one pass.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "color.glsl"
#include "trace.glsl"

layout(local_size_x_id = 0, local_size_y_id = 1) in;
// Colours as sRGB bytes, a word a pixel, and no hit records: for the screen.
layout(constant_id = 4) const bool SCREEN = false;

void main() {
    uvec2 pixel = dealt(gl_WorkGroupSize);
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    uint at = pixel.y * frame.width + pixel.x;
    Ray ray = ray_at(sample_of(pixel));
    Hit hit = trace_pixel(pixel, ray);

    uint bits = BITS_MISS;
    vec4 color;
    if (hit.slot != NO_NODE) {
        Seen seen = seen_at(hit.slot, hit.column, uint(hit.top));
        color = vec4(seen.srgb, 1.0);
        bits = SCREEN ? seen.class_ : bits_of(seen, hit.slot, hit.column, hit.face);
    }
    if (SCREEN) {
        if (bits == BITS_MISS) color = vec4(vec3(frame.background == 1u ? 1.0 : frame.background == 2u ? 0.8 : 0.0), frame.background == 0u ? 0.0 : 1.0);
        SCREEN_IMAGE[at] = packUnorm4x8(color);
    } else {
        color = bits == BITS_MISS ? background(ray.world) : vec4(linear_of(color.rgb), 1.0);
        vec4 sum = color * push.sample_weight;
        if (push.sample_index > 0u) sum += COLOR[at];
        COLOR[at] = sum;
        HIT[at] = uvec4(floatBitsToUint(hit.t), bits, min(hit.steps, 8191u), uint(hit.top));
    }
}
