// The traversal: one ray through the table, pyramids and columns (walk.glsl) to its hit (leaf.glsl).
// Needs pool.glsl, section.glsl, frame.glsl.
#include "lookup.glsl"
#ifdef STACKED
#include "floats.glsl"
#endif
#ifdef SMOOTH
#include "corners.glsl"
#include "joins.glsl"
#endif
#include "leaf.glsl"
#ifdef SMOOTH
#define WALKED
#include "tubes.glsl"
#endif
#include "walk.glsl"

// Whether rays start behind beams, or at the eye.
layout(constant_id = ID_BEAMED) const bool BEAMED = true;

// The hit of a pixel of the band behind the beam of its tile.
Hit trace_pixel(uvec2 pixel, Ray ray) {
    if (!BEAMED) return trace(ray, ray.start, frame.top_level);
    uvec2 tile = pixel / TILE;
    uint beam = beam_at(tile.y * ((frame.width + TILE - 1u) / TILE) + tile.x);
    // A little before, for rounding.
    float start = beam_depth(beam) * ray.unit;
    start = max(start - 1e-6 * abs(start), ray.start);
    return trace(ray, start, min(beam_level(beam), frame.top_level));
}
