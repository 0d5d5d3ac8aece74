// Traces one ray a pixel and writes the hit records.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "trace.glsl"

layout(local_size_x_id = 0, local_size_y_id = 1) in;

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    Ray ray = ray_at(sample_of(pixel));
    uvec2 tile = pixel / TILE;
    vec2 beam = BEAM[tile.y * ((frame.width + TILE - 1u) / TILE) + tile.x];
    // A little before, for rounding.
    float start = beam.x * ray.unit;
    start = max(start - 1e-6 * abs(start), ray.start);
    Hit hit = trace(ray, start, min(int(beam.y), frame.top_level));
    HIT[pixel.y * frame.width + pixel.x] = uvec4(floatBitsToUint(hit.t), hit.slot, hit.column.y << SECTION_LOG2 | hit.column.x | hit.face << 16u | min(hit.steps, 8191u) << 19u, uint(hit.top));
}
