// What the window's drawing shares: triangles and their texture, all in buffers.
// Colours are sRGB-encoded and multiplied by alpha, and are blended so, as the toolkit wants it.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

struct Vertex {
    vec2 at; // points from the window's top left corner
    vec2 uv; // of the texture, 0..1
    uint color;
};
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Vertices { Vertex vertices[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Indices { uint indices[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Texels { uint texels[]; };
layout(push_constant, scalar) uniform Push {
    Vertices vertices;
    Indices indices;
    Texels texels;
    ivec2 size;     // of the texture
    vec2 to_clip;   // from points
    uint is_smooth; // texels are interpolated; else the nearest is taken
} push;
