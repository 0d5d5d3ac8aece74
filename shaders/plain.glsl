// The plain traversal of the thesis (§3.2.3, after Dick, Krüger and Westermann 2009): the ray is mirrored so
// that it goes east and north, and moves from node border to node border; down a level at an intersection, up
// a level when it leaves a 2x2 square.
// Needs frame.glsl, and of whoever includes it: PlainNode { top, there, ... }, plain_top_level, plain_node, plain_hit.

uvec4 trace(Ray ray) {
    uvec4 hit = uvec4(0u, NO_NODE, 0u, 0u);

    // 1a. Only step.xy >= 0 is handled: other rays are mirrored, and cells with them (i becomes -1 - i).
    ivec2 mirror = ivec2(lessThan(ray.step.xy, vec2(0.0)));
    vec2 direction = abs(ray.step.xy);
    vec2 inverse = mix(1.0 / direction, vec2(1e30), lessThan(direction, vec2(1e-20)));
    ivec2 cell = ray.cell.xy ^ -mirror;
    vec2 fraction = mix(ray.fraction.xy, 1.0 - ray.fraction.xy, equal(mirror, ivec2(1)));
    ivec2 low = mix(frame.low, -frame.high, equal(mirror, ivec2(1)));
    ivec2 high = mix(frame.high, -frame.low, equal(mirror, ivec2(1)));
    uint face = FACE_INSIDE;
    float t = ray.start;
    float z0 = origin_height(ray);

    // To the eye, or on to the border of what there is.
    vec2 ahead = (vec2(low - cell) - fraction) * inverse;
    for (int axis = 0; axis < 2; axis++) {
        if (ahead[axis] <= t) continue;
        t = ahead[axis];
        face = (axis == 0 ? FACE_WEST : FACE_SOUTH) + uint(mirror[axis]);
    }
    if (t > FAR) return hit;
    vec2 at = fma(vec2(t), direction, fraction);
    cell += ivec2(floor(at));
    fraction = at - floor(at);
    // Exactly on the border that was crossed, rounding or not.
    bvec2 crossed = equal(ahead, vec2(t));
    fraction = mix(fraction, vec2(0.0), crossed);
    cell = max(mix(cell, low, crossed), low);

    const int top_level = plain_top_level();
    int level = top_level;
    while (all(greaterThanEqual(cell, low)) && all(lessThan(cell, high))) {
        log_step();
        // 2a. Exit point: the nearer of the two borders, set exactly.
        ivec2 edge = (cell >> level) + 1;
        vec2 steps = (vec2((edge << level) - cell) - fraction) * inverse;
        // At a corner an eastward step comes first, a westward one last.
        int axis = (mirror.x == 0 ? steps.x <= steps.y : steps.x < steps.y) ? 0 : 1, other = 1 - axis;
        float t_exit = t + steps[axis];

        // 2b. Intersection.
        ivec2 real = cell ^ -mirror;
        float enter = fma(t, ray.step.z, z0), leave = fma(t_exit, ray.step.z, z0);
        PlainNode node = plain_node(real, level);
        bool intersects = (ray.step.z >= 0.0 ? enter : leave) <= float(node.top) && node.there;
        // Not where the ray only touches a corner on the way from the south-west to the north-east or back.
        intersects = intersects && (t_exit > t || mirror.x != mirror.y || face == FACE_INSIDE);

        // 2c. Down a level, or the column itself.
        if (intersects) {
            if (level > 0) {
                level--;
                continue;
            }
            float t_hit = t;
            if (enter > float(node.top)) {
                float rise = mix(float(node.top) - z0, float(node.top - ray.cell.z) - ray.fraction.z, frame.origin_step == 1.0);
                t_hit = clamp(rise / ray.step.z, t, t_exit);
                face = FACE_TOP;
            }
            return plain_hit(t_hit, node, real, face);
        }

        // 2d. On to the exit; up a level where a 2x2 square ends.
        if (t_exit > FAR) break;
        t = t_exit;
        float across = fma(steps[axis], direction[other], fraction[other]);
        ivec2 last = (cell >> level) + 1 << level;
        fraction[other] = across - floor(across);
        cell[other] = cell[other] + int(floor(across));
        if (cell[other] >= last[other]) { // rounded past the node's corner
            cell[other] = last[other] - 1;
            fraction[other] = 0.99999994;
        }
        cell[axis] = edge[axis] << level;
        fraction[axis] = 0.0;
        face = (axis == 0 ? FACE_WEST : FACE_SOUTH) + uint(mirror[axis]);
        level = min(level + 1 - (edge[axis] & 1), top_level);
    }
    return hit;
}
