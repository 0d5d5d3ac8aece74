// Traces one ray a pixel and gives it its column's very colour: the whole of an exact image in one pass.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "color.glsl"
#include "trace.glsl"

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;
// Colours as sRGB bytes, a word a pixel, and no hit records: for the screen.
layout(constant_id = ID_SCREEN) const bool SCREEN = false;

void main() {
    uvec2 pixel = dealt_pixel(gl_WorkGroupSize);
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    uint at = pixel.y * frame.width + pixel.x;
    Ray ray = ray_of(pixel);
#ifdef LOGGED
    log_begin(frame.colors, at);
#endif
    Hit hit = trace_pixel(pixel, ray);
#ifdef LOGGED
    log_end();
    return;
#endif

    bool miss = hit.slot == NO_NODE;
#ifdef STACKED
    uint shows = miss ? 0u : shown_at(hit.slot, hit.column, hit.steps);
    bool is_span = hit.steps != 0u;
    hit.steps = 0u;
#else
    uint shows = miss ? 0u : shown_at(hit.slot, hit.column);
    const bool is_span = false;
#endif
    if (SCREEN) {
        // Signed numbers, which CPUs convert eight at once.
        ivec3 color = RAMPED ? ivec3(srgb_of(shows, uint(hit.top)) * 255.0 + 0.5) : ivec3(0);
        uint rgb = RAMPED ? uint(color.r | color.g << 8 | color.b << 16) : shows & 0xFFFFFFu;
        uint behind = frame.background == BACKGROUND_NONE ? 0u : frame.background == BACKGROUND_WHITE ? 0xFFFFFFFFu : 0xFFCCCCCCu;
        SCREEN_IMAGE[at] = miss ? behind : 0xFF000000u | rgb;
    } else {
        uint bits = miss ? BITS_MISS : bits_of(shows, hit.slot, hit.column, hit.face, is_span);
        vec4 sum = (miss ? background(ray.world) : vec4(linear_of(srgb_of(shows, uint(hit.top))), 1.0)) * push.sample_weight;
        if (push.sample_index > 0u) sum += COLOR[at];
        COLOR[at] = sum;
        HIT[at] = uvec4(floatBitsToUint(hit.t), bits, rest_of(hit.steps, shows), uint(hit.top));
    }
}
