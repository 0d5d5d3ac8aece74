//! A peer on the CPU: the same columns, and a mesh through their tops, traced by Intel Embree.

use super::frames;
use super::pool::PoolPipeline;
use super::report::{PeerRow, Stat};
use super::steady::{self, Repeats, WarmUp};
use super::world::World;
use crate::gpu::{Gpu, QueueKind, Timestamps};
use crate::render::camera::{Camera, Projection};
use embree3::{
    Bounds, BufferUsage, Config, Device, Format, Geometry, GeometryKind, Hit, Hit8, INVALID_ID,
    IntersectContext, IntersectFunctionNArgs, Ray, Ray8, RayHit, RayHit8, RayHitNp, RayNp, Scene, SoAHit,
    SoARay, ValidMaskN,
};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Pixels along a side of what a thread takes at a time.
const TILE: usize = 8;

/// Square of columns; x is east from the west border, y north from the south border, z up, all in one unit.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightField {
    /// Columns along a side.
    pub side_cells: u32,
    /// Side of a column.
    pub cell: f64,
    /// Tops, row by row from the south, each from the west; NaN: no column.
    pub heights: Vec<f32>,
}

impl HeightField {
    /// Where columns end below: a cell under the lowest top.
    pub fn floor(&self) -> f32 {
        self.heights.iter().copied().fold(f32::INFINITY, f32::min) - self.cell as f32
    }
}

/// The rays of a picture, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rays {
    /// Rays a row.
    pub width: usize,
    /// Where they start.
    pub origins: Vec<[f32; 3]>,
    /// Where they go; not normalised.
    pub directions: Vec<[f32; 3]>,
}

/// What Embree is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PeerScene {
    /// Each column as a user geometry: its bounds, and a callback that intersects.
    Columns,
    /// Two triangles between the middles of four neighbouring columns.
    Mesh,
}

/// How rays are handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Query {
    /// One by one.
    Single,
    /// Packets of 4 × 2 pixels, coherent.
    Packet,
    /// Streams of 8 × 8 pixels, coherent.
    Stream,
}

impl Query {
    /// To take the fastest of.
    pub const ALL: [Query; 3] = [Query::Single, Query::Packet, Query::Stream];
}

/// What Embree cannot do.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PeerError {
    /// It says so.
    #[error("Embree: {0}")]
    Embree(String),
    /// Nothing to trace.
    #[error("the height field holds nothing to trace")]
    Empty,
    /// More than it counts.
    #[error("{0} primitives are more than Embree can number")]
    TooMany(usize),
}

impl From<embree3::Error> for PeerError {
    fn from(error: embree3::Error) -> PeerError {
        PeerError::Embree(format!("{error:?}"))
    }
}

/// A built scene.
pub struct Peer {
    scene: Scene<'static>,
    threads: u32,
    build_s: f64,
}

/// What came of tracing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traced {
    /// From origin to hit in lengths of the ray's direction, as the rays are ordered; +inf on a miss.
    pub distance: Vec<f32>,
    /// That it took.
    pub seconds: f64,
}

impl Peer {
    /// Builds on `threads` threads.
    ///
    /// Panics if `heights` is no square of `side_cells`.
    pub fn build(field: &HeightField, scene: PeerScene, threads: u32) -> Result<Peer, PeerError> {
        let side = field.side_cells as usize;
        assert_eq!(field.heights.len(), side * side, "a height a column");
        // Making a device turns off denormals in the thread that does.
        std::thread::scope(|scope| {
            let work = scope.spawn(|| Peer::build_here(field, scene, threads));
            work.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    fn build_here(field: &HeightField, kind: PeerScene, threads: u32) -> Result<Peer, PeerError> {
        let config = Config { threads, start_threads: true, ..Config::default() };
        let device = Device::with_config(config)?;
        let start = Instant::now();
        let geometry = match kind {
            PeerScene::Columns => columns(&device, field)?,
            PeerScene::Mesh => mesh(&device, field)?,
        };
        let mut scene = device.create_scene()?;
        scene.attach_geometry(&geometry);
        scene.commit();
        let build_s = start.elapsed().as_secs_f64();
        match device.get_error() {
            embree3::Error::NONE => Ok(Peer { scene, threads, build_s }),
            error => Err(error.into()),
        }
    }

    /// Seconds that the last build took: primitives and hierarchy.
    pub fn build_seconds(&self) -> f64 {
        self.build_s
    }

    /// Traces all rays, tiles of 8 × 8 pixels on as many threads as it was built on.
    pub fn trace(&self, rays: &Rays, query: Query) -> Traced {
        let (width, height) = (rays.width.max(1), rays.origins.len() / rays.width.max(1));
        let across = width.div_ceil(TILE);
        let mut tiles = vec![[f32::INFINITY; TILE * TILE]; across * height.div_ceil(TILE)];
        let start = Instant::now();
        let work = Mutex::new(tiles.iter_mut().enumerate());
        std::thread::scope(|scope| {
            for _ in 0..self.threads.max(1) {
                scope.spawn(|| {
                    embree3::enable_ftz_and_daz();
                    let mut tracer = Tracer::new(&self.scene, query);
                    loop {
                        let next = work.lock().unwrap_or_else(|e| e.into_inner()).next();
                        let Some((at, distance)) = next else { return };
                        tracer.tile(rays, [at % across * TILE, at / across * TILE], height, distance);
                    }
                });
            }
        });
        let seconds = start.elapsed().as_secs_f64();
        let place =
            |at: usize| (at / width / TILE * across + at % width / TILE, lane(at % width, at / width));
        let distance = (0..width * height).map(place).map(|(tile, lane)| tiles[tile][lane]).collect();
        Traced { distance, seconds }
    }
}

/// Cells along a side of what is traced, at most.
const MOST_CELLS: u32 = 4096;
/// Times that everything is traced.
const REPEATS: u32 = 9;

/// Embree's columns and mesh beside our pipeline: the same cells, the same rays, from low over the south-western
/// corner across them.
pub fn run(
    gpu: &Gpu,
    world: &World,
    size: [u32; 2],
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Vec<PeerRow>> {
    let (cell, side) = (world.grid.cell(), world.cells().into_iter().min().unwrap_or(0).min(MOST_CELLS));
    let low = world.corner();
    let window = [low, low.map(|c| c + side as i32)];
    let west_south = [0, 1].map(|a| (i64::from(low[a]) + world.grid.anchor[a]) as f64 * cell);
    let origin = glam::DVec3::new(west_south[0], west_south[1], world.grid.units(world.anchor));

    let mut heights = vec![0.0; side as usize * side as usize];
    let mut colors = vec![0; side as usize];
    for (y, row) in (low[1]..).zip(heights.chunks_exact_mut(side as usize)) {
        world.row([low[0], y], row, &mut colors);
    }
    for height in &mut heights {
        *height = if height.is_finite() { *height * world.grid.height_step as f32 } else { f32::NAN };
    }
    let field = HeightField { side_cells: side, cell, heights };

    let length = f64::from(side) * cell;
    let [ground, top] = world.relief();
    let eye = (origin + glam::DVec3::new(0.05, 0.05, 0.0) * length).with_z(top.max(ground) + 0.04 * length);
    let camera = Camera::looking(eye, [45.0, 12.0], Projection::default())?;
    let basis = camera.basis(size)?;
    let mut rays = Rays { width: size[0] as usize, ..Rays::default() };
    let mut lengths = Vec::new();
    for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (f64::from(x), f64::from(y)))) {
        rays.origins.push((basis.origin(x, y) - origin).as_vec3().into());
        rays.directions.push(basis.direction(x, y).as_vec3().into());
        lengths.push(basis.direction(x, y).length());
    }

    progress("our own picture");
    let mut pool = PoolPipeline::new(gpu, world, side)?;
    pool.load(world, window)?;
    let view = frames::view(world, &camera, size, window);
    let picture = pool.picture(&view)?;
    let mut warm_up = WarmUp::new(gpu.info().kind);
    let mut clock = Timestamps::new(gpu, "traced", QueueKind::Compute, WarmUp::STAGES)?;
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    let mut rows = Vec::new();
    for (scene, name) in [(PeerScene::Columns, "columns"), (PeerScene::Mesh, "mesh")] {
        progress(&format!("Embree: building {name} of {side} x {side} cells"));
        let peer = Peer::build(&field, scene, threads)?;
        progress(&format!("{name}: both in turn"));
        let mut pool_times = Repeats::default();
        let mut times = Query::ALL.map(|query| (query, Repeats::default()));
        let mut traced = Traced::default();
        // In turn, so that what else the machine does is the same for all.
        for _ in 0..REPEATS {
            match &mut clock {
                Some(clock) => {
                    let timing = pool.time(&view, &mut warm_up, clock)?;
                    pool_times.push(timing.all_ms, timing.is_warm);
                }
                // As it is seen from the host, of a device that has no clock.
                None => pool_times.push(pool.frame(world, window, &[], Some(&view))?.0.trace_wall_ms, true),
            }
            for (query, times) in &mut times {
                traced = peer.trace(&rays, *query);
                times.push(traced.seconds, true);
            }
        }
        let fastest = steady::best(times.iter().map(|(_, times)| times)).expect("there are queries");
        let (query, peer_times) = &times[fastest];
        let stat = |times: &Repeats| Stat::of(times.ms.clone()).expect("there are repeats");
        let (pool_ms, trace_s) = (stat(&pool_times), stat(peer_times));
        let same = (0..lengths.len()).filter(|&at| {
            let (theirs, ours) =
                (f64::from(traced.distance[at]) * lengths[at], f64::from(picture.distance[at]));
            theirs == ours || (theirs - ours).abs() <= cell.max(ours * 1e-3)
        });
        let agree = same.count() as f64 / lengths.len() as f64;
        let all = lengths.len() as f64 / 1e6;
        let mrays_s = [all / trace_s.median, all / pool_ms.median * 1e3];
        rows.push(PeerRow {
            scene: format!("Embree {name}"),
            query: format!("{query:?}").to_lowercase(),
            cells: side,
            rays: lengths.len() as u64,
            threads,
            build_s: peer.build_seconds(),
            trace_s,
            pool_ms,
            mrays_s,
            spreads: [peer_times.spread(), pool_times.spread()],
            // Seconds over milliseconds.
            ratio: peer_times.ratio_to(&pool_times).map(|ratio| 1e3 * ratio),
            agree,
        });
    }
    Ok(rows)
}

/// Place in a tile: blocks of 4 × 2 pixels, one packet each.
fn lane(x: usize, y: usize) -> usize {
    let (x, y) = (x % TILE, y % TILE);
    (y / 2 * 2 + x / 4) * 8 + y % 2 * 4 + x % 4
}

/// Pixel of a place in a tile.
fn pixel(lane: usize) -> [usize; 2] {
    let (block, within) = (lane / 8, lane % 8);
    [block % 2 * 4 + within % 4, block / 2 * 2 + within / 4]
}

/// Embree reads masks with as wide loads as it has.
#[repr(align(64))]
struct Mask(ValidMaskN<8>);

struct Tracer<'a> {
    scene: &'a Scene<'static>,
    context: IntersectContext,
    query: Query,
    all: Mask,
    stream: RayHitNp,
}

impl<'a> Tracer<'a> {
    fn new(scene: &'a Scene<'static>, query: Query) -> Tracer<'a> {
        let context = match query {
            Query::Single => IntersectContext::incoherent(),
            Query::Packet | Query::Stream => IntersectContext::coherent(),
        };
        let stream = RayHitNp::new(RayNp::new(TILE * TILE));
        Tracer { scene, context, query, all: Mask(ValidMaskN::all_active()), stream }
    }

    /// Distances of the tile at `first`; pixels beyond the picture repeat its last ones.
    fn tile(&mut self, rays: &Rays, first: [usize; 2], height: usize, distance: &mut [f32; TILE * TILE]) {
        let ray = |lane: usize| {
            let [x, y] = pixel(lane);
            let at = (first[1] + y).min(height - 1) * rays.width + (first[0] + x).min(rays.width - 1);
            (rays.origins[at], rays.directions[at])
        };
        let found = |hit: bool, t: f32| if hit { t } else { f32::INFINITY };
        match self.query {
            Query::Single => {
                for (lane, distance) in distance.iter_mut().enumerate() {
                    let (origin, direction) = ray(lane);
                    let mut one = RayHit::from(Ray::segment(origin, direction, 0.0, f32::INFINITY));
                    self.scene.intersect(&mut self.context, &mut one);
                    *distance = found(one.hit.is_valid(), one.ray.tfar);
                }
            }
            Query::Packet => {
                for (packet, distance) in distance.chunks_exact_mut(8).enumerate() {
                    let all: [_; 8] = std::array::from_fn(|k| ray(packet * 8 + k));
                    let packet = Ray8::new(all.map(|r| r.0), all.map(|r| r.1));
                    let mut eight = RayHit8 { ray: packet, hit: Hit8::new() };
                    self.scene.intersect8(&mut self.context, &mut eight, &self.all.0);
                    for (k, distance) in distance.iter_mut().enumerate() {
                        *distance = found(eight.hit.geom_id(k) != INVALID_ID, eight.ray.tfar(k));
                    }
                }
            }
            Query::Stream => {
                let stream = &mut self.stream;
                for lane in 0..TILE * TILE {
                    let (origin, direction) = ray(lane);
                    stream.ray.set_org(lane, origin);
                    stream.ray.set_dir(lane, direction);
                    stream.ray.set_tnear(lane, 0.0);
                    stream.ray.set_tfar(lane, f32::INFINITY);
                    stream.hit.set_geom_id(lane, INVALID_ID);
                }
                self.scene.intersect_stream_soa(&mut self.context, stream);
                for (lane, distance) in distance.iter_mut().enumerate() {
                    *distance = found(stream.hit.geom_id(lane) != INVALID_ID, stream.ray.tfar(lane));
                }
            }
        }
    }
}

/// What a callback needs of a column: south-west corner and top.
struct Columns {
    cell: f32,
    floor: f32,
    /// West, south, top.
    all: Vec<[f32; 3]>,
}

fn columns(device: &Device, field: &HeightField) -> Result<Geometry<'static>, PeerError> {
    let (side, cell) = (field.side_cells as usize, field.cell);
    let there = field.heights.iter().enumerate().filter(|(_, top)| !top.is_nan());
    let corner = |at: usize| [(at % side) as f64 * cell, (at / side) as f64 * cell].map(|v| v as f32);
    let all: Vec<_> = there.map(|(at, &top)| [corner(at)[0], corner(at)[1], top]).collect();
    let count = counted(all.len())?;
    let columns = Arc::new(Columns { cell: cell as f32, floor: field.floor(), all });
    let mut geometry = device.create_geometry(GeometryKind::USER)?;
    geometry.set_primitive_count(count);
    let of = Arc::clone(&columns);
    geometry.set_bounds_function::<_, ()>(move |bounds: &mut Bounds, primitive, _, _| {
        let [west, south, top] = of.all[primitive as usize];
        (bounds.lower_x, bounds.lower_y, bounds.lower_z) = (west, south, of.floor);
        (bounds.upper_x, bounds.upper_y, bounds.upper_z) = (west + of.cell, south + of.cell, top);
    });
    geometry.set_intersect_function::<_, ()>(move |args: &mut IntersectFunctionNArgs<()>| {
        let (primitive, geometry) = (args.prim_id(), args.geom_id());
        let [west, south, top] = columns.all[primitive as usize];
        let low = [west, south, columns.floor];
        let high = [west + columns.cell, south + columns.cell, top];
        args.for_each_active_lane(|mut lane| {
            let mut ray = lane.ray();
            let Some((t, axis)) = enter(&ray, low, high) else { return };
            let normal = |k: usize| if k == axis { -ray.dir()[k].signum() } else { 0.0 };
            let hit = Hit {
                Ng_x: normal(0),
                Ng_y: normal(1),
                Ng_z: normal(2),
                u: 0.0,
                v: 0.0,
                primID: primitive,
                geomID: geometry,
                instID: [INVALID_ID],
            };
            ray.tfar = t;
            lane.commit_hit(&ray, &hit);
        });
    });
    Ok(geometry.commit())
}

/// Where `ray` enters the box, before its `tfar`, and through a side across which axis.
#[inline(always)]
fn enter(ray: &Ray, low: [f32; 3], high: [f32; 3]) -> Option<(f32, usize)> {
    let (from, to) = (ray.org(), ray.dir());
    let (mut near, mut far, mut axis) = (ray.tnear, ray.tfar, 2);
    for k in 0..3 {
        let inverse = 1.0 / to[k];
        let (a, b) = ((low[k] - from[k]) * inverse, (high[k] - from[k]) * inverse);
        // min and max leave out the NaN of a ray that runs along a side.
        if a.min(b) > near {
            (near, axis) = (a.min(b), k);
        }
        far = far.min(a.max(b));
    }
    (near <= far && near < ray.tfar).then_some((near, axis))
}

fn mesh(device: &Device, field: &HeightField) -> Result<Geometry<'static>, PeerError> {
    let side = field.side_cells as usize;
    let cells = (0..side.saturating_sub(1)).flat_map(|j| (0..side - 1).map(move |i| (j * side + i) as u32));
    let n = side as u32;
    let triangles: Vec<[u32; 3]> = cells
        .flat_map(|a| [[a, a + 1, a + n + 1], [a, a + n + 1, a + n]])
        .filter(|corners| corners.iter().all(|&at| !field.heights[at as usize].is_nan()))
        .collect();
    counted(triangles.len())?;
    let mut geometry = device.create_geometry(GeometryKind::TRIANGLE)?;
    let mut vertices = geometry.set_new_buffer::<[f32; 3]>(
        BufferUsage::VERTEX,
        0,
        Format::FLOAT3,
        size_of::<[f32; 3]>(),
        side * side,
    )?;
    for (at, (vertex, &top)) in vertices.iter_mut().zip(&field.heights).enumerate() {
        let middle = |k: usize| ((k as f64 + 0.5) * field.cell) as f32;
        // No triangle has a corner without a height.
        *vertex = [middle(at % side), middle(at / side), if top.is_nan() { 0.0 } else { top }];
    }
    geometry
        .set_new_buffer::<[u32; 3]>(
            BufferUsage::INDEX,
            0,
            Format::UINT3,
            size_of::<[u32; 3]>(),
            triangles.len(),
        )?
        .copy_from_slice(&triangles);
    Ok(geometry.commit())
}

fn counted(primitives: usize) -> Result<u32, PeerError> {
    match u32::try_from(primitives) {
        Ok(0) => Err(PeerError::Empty),
        Ok(count) if count < INVALID_ID => Ok(count),
        _ => Err(PeerError::TooMany(primitives)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 24;
    const CELL: f64 = 0.5;

    fn field() -> HeightField {
        let height = |at: u32| {
            let (i, j) = (f64::from(at % SIDE), f64::from(at / SIDE));
            match at {
                _ if (i - 8.0).hypot(j - 14.0) < 3.0 => f32::NAN,
                _ if at.is_multiple_of(37) => 6.0,
                _ => (2.0 + (i * 0.7).sin() + (j * 0.4).cos() + f64::from(at * 7919 % 13) * 0.05) as f32,
            }
        };
        HeightField { side_cells: SIDE, cell: CELL, heights: (0..SIDE * SIDE).map(height).collect() }
    }

    /// A picture that is no whole number of tiles, from the south-west and above.
    fn rays() -> Rays {
        let (width, height) = (61, 43);
        let pixel = |at: usize| [(at % width) as f32 / 61.0 - 0.5, 0.5 - (at / width) as f32 / 43.0];
        let direction = |[x, y]: [f32; 2]| [0.7 + 0.6 * x, 0.7 - 0.6 * x, -0.5 + 0.9 * y];
        let directions: Vec<_> = (0..width * height).map(pixel).map(direction).collect();
        Rays { width, origins: vec![[-3.1, -2.9, 8.3]; directions.len()], directions }
    }

    /// Steps of a 64th of a cell, until `hit` holds between two. Independent of boxes and hierarchies.
    fn march(rays: &Rays, at: usize, hit: impl Fn([f64; 3], [f64; 3]) -> bool) -> f64 {
        let [o, d] = [rays.origins[at], rays.directions[at]].map(|v| v.map(f64::from));
        let step = CELL / 64.0 / d.iter().map(|v| v * v).sum::<f64>().sqrt();
        let place = |t: f64| std::array::from_fn(|k| o[k] + d[k] * t);
        let mut times = (1..20_000).map(|k| f64::from(k) * step);
        times.find(|t| hit(place(t - step), place(*t))).unwrap_or(f64::INFINITY)
    }

    /// Rays that find something else than marching does, beyond what a step can tell, and all hits.
    fn disagree(scene: PeerScene, hit: impl Fn([f64; 3], [f64; 3]) -> bool) -> [usize; 2] {
        let (field, rays) = (field(), rays());
        let peer = Peer::build(&field, scene, 2).unwrap();
        assert!(peer.build_seconds() > 0.0);
        let all = Query::ALL.map(|query| peer.trace(&rays, query));
        assert!(all.iter().all(|t| t.seconds > 0.0 && t.distance.len() == 61 * 43));
        let marched: Vec<_> = (0..rays.origins.len()).map(|at| march(&rays, at, &hit)).collect();
        let (mut same, mut hits) = (0, 0);
        for (at, want) in marched.iter().enumerate() {
            for (traced, query) in all.iter().zip(Query::ALL) {
                let got = f64::from(traced.distance[at]);
                let fits = got == *want || (got - want).abs() < 0.02;
                same += usize::from(fits);
                hits += usize::from(want.is_finite());
                if !fits {
                    println!("{scene:?} {query:?} ray {at}: {got}, marched {want}");
                }
            }
        }
        [all.len() * marched.len() - same, hits]
    }

    #[test]
    fn columns_are_hit_where_marching_does() {
        let field = field();
        let floor = f64::from(field.floor());
        let [other, hits] = disagree(PeerScene::Columns, |_, [x, y, z]| {
            let (i, j) = ((x / CELL).floor(), (y / CELL).floor());
            let inside = |k: f64| (0.0..f64::from(SIDE)).contains(&k);
            // A NaN is below nothing.
            inside(i)
                && inside(j)
                && z >= floor
                && z <= f64::from(field.heights[(j * f64::from(SIDE) + i) as usize])
        });
        assert!(hits > 3000);
        // A step may jump over a corner.
        assert!(other <= 30, "{other}");
    }

    #[test]
    fn meshes_are_hit_where_marching_does() {
        let field = field();
        let at = |i: f64, j: f64| f64::from(field.heights[(j * f64::from(SIDE) + i) as usize]);
        let above = |[x, y, z]: [f64; 3]| {
            let (x, y) = (x / CELL - 0.5, y / CELL - 0.5);
            let last = f64::from(SIDE - 1);
            if !((0.0..last).contains(&x) && (0.0..last).contains(&y)) {
                return None;
            }
            let (i, j, u, v) = (x.floor(), y.floor(), x.fract(), y.fract());
            let (a, c) = (at(i, j), at(i + 1.0, j + 1.0));
            let top = match u >= v {
                true => a + (at(i + 1.0, j) - a) * (u - v) + (c - a) * v,
                false => a + (at(i, j + 1.0) - a) * (v - u) + (c - a) * u,
            };
            (!top.is_nan()).then_some(z > top)
        };
        let [other, hits] = disagree(PeerScene::Mesh, |before, after| {
            above(before).zip(above(after)).is_some_and(|(before, after)| before != after)
        });
        assert!(hits > 2500);
        assert!(other <= 30, "{other}");
    }

    #[test]
    fn nothing_is_refused() {
        let none = HeightField { side_cells: 2, cell: 1.0, heights: vec![f32::NAN; 4] };
        for scene in [PeerScene::Columns, PeerScene::Mesh] {
            assert_eq!(Peer::build(&none, scene, 1).err(), Some(PeerError::Empty));
        }
        for at in 0..TILE * TILE {
            let [x, y] = pixel(at);
            assert_eq!(lane(x, y), at);
        }
    }
}
