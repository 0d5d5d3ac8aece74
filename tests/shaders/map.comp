// to[i] = from[(i + shift) % count] * factor + 1. One thread an element; the shift makes threads read what
// other workgroups of the pass before wrote.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "places.glsl"

layout(local_size_x_id = 0) in;

layout(push_constant, scalar) uniform Push {
    uvec2 from;
    uvec2 to;
    uint count;
    uint shift;
    uint factor;
};

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) store(to, i, load(from, (i + shift) % count) * factor + 1);
}
