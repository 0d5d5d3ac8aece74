// Traces one ray a pixel and writes the hit records.
#version 460
#extension GL_GOOGLE_include_directive : require
#define FRAME_STORED
#include "pool.glsl"
#include "section.glsl"
#include "frame.glsl"
#include "trace.glsl"

layout(local_size_x_id = ID_GROUP_X, local_size_y_id = ID_GROUP_Y) in;

void main() {
    uvec2 pixel = dealt_pixel(gl_WorkGroupSize);
    if (pixel.x >= frame.width || pixel.y >= push.rows) return;
    HIT[pixel.y * frame.width + pixel.x] = record_of(trace_pixel(pixel, ray_of(pixel)));
}
