// A vertex of the window's drawing. Reads indices and vertices.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "overlay.glsl"

layout(location = 0) out vec4 color;
layout(location = 1) out vec2 uv;

void main() {
    Vertex vertex = push.vertices.vertices[push.indices.indices[gl_VertexIndex]];
    gl_Position = vec4(vertex.at * push.to_clip - 1.0, 0.0, 1.0);
    color = unpackUnorm4x8(vertex.color);
    uv = vertex.uv;
}
