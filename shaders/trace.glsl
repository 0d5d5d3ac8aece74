// The traversal: one ray through the table, pyramids and columns (walk.glsl) to its hit (leaf.glsl).
// Needs pool.glsl, section.glsl, frame.glsl.
#include "lookup.glsl"
#include "walk.glsl"
#include "leaf.glsl"

// Traces `ray` from t `start` on, where it is known to be above everything, beginning at `level`.
Hit trace(Ray ray, float start, int level) {
    Walk walk = begin_walk(ray, start, level);
    uint slot = NO_NODE;
    int detail = 0, top = 0;
    bool found = false;
    // Left by its condition alone: see walk.glsl.
    while (!found && !walk.gone) {
        slot = through_table(walk);
        if (!walk.gone) {
            detail = detail_of(slot);
            found = through_sections(walk, slot, detail, top);
        }
    }
    if (!found || !is_in_window(walk)) return no_hit(walk.steps);
    return hit_in(walk, ray, slot, detail, top);
}

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
