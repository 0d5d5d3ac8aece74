//! Which sections are to be seen where: the cut through the quadtree of sections, and what stands in for members
//! that are not there yet. Pure.
//!
//! The cut follows from the camera and from what the files' headers say (design: a section is replaced by its children
//! where its cells cover more than a pixel at its nearest point). It never depends on what is resident.

use crate::coords::{Extent, Grid, SECTION_LOG2, SectionKey};
use crate::ingest::sparse;
use crate::limits::LIMITS;
use crate::section::PayloadKey;
use glam::DVec3;

/// Coarsest detail level: the grid's anchor allows for no more.
pub const MOST_LEVEL: u8 = 18;
/// Columns around a section that shading looks at from within it.
const HALO: f64 = 17.0;

/// What a camera sees, and how large.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// Half spaces: normal inwards, and its product with the points of the border. World as shown, CRS units.
    pub planes: Vec<(DVec3, f64)>,
    /// Where rays start; `None` where they are parallel.
    pub eye: Option<DVec3>,
    /// Side of a pixel, CRS units: a unit away from the eye, or anywhere.
    pub pixel: f64,
    /// Vertical exaggeration about a height, CRS units.
    pub z_scale: f64,
    /// That height.
    pub pivot: f64,
    /// Columns are seen down to here, CRS units.
    pub floor: f64,
    /// Pixels that a cell may cover; 0: finest cells everywhere.
    pub detail: f64,
}

impl Sight {
    /// The same, seen from somewhere else.
    pub fn moved(&self, by: DVec3) -> Sight {
        let plane = |&(normal, least): &(DVec3, f64)| (normal, least + normal.dot(by));
        Sight {
            planes: self.planes.iter().map(plane).collect(),
            eye: self.eye.map(|eye| eye + by),
            ..self.clone()
        }
    }

    /// Whether something of the box may be seen.
    fn sees(&self, [low, high]: &[DVec3; 2]) -> bool {
        self.planes.iter().all(|&(normal, least)| {
            let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), *high, *low);
            normal.dot(farthest) >= least
        })
    }

    /// Pixels that `length` covers where the box is nearest.
    fn pixels(&self, length: f64, [low, high]: &[DVec3; 2]) -> f64 {
        let distance = self.eye.map_or(1.0, |eye| (eye - eye.clamp(*low, *high)).length());
        length / (self.pixel * distance)
    }

    fn shown(&self, height: f64) -> f64 {
        self.pivot + (height - self.pivot) * self.z_scale
    }
}

/// All that there is to be seen.
#[derive(Clone, Debug, Default)]
pub struct Domain {
    extents: Vec<Extent>,
    roots: Vec<SectionKey>,
    /// Place of cell 0, 0, CRS units, and the side of a finest cell.
    origin: [f64; 2],
    cell: f64,
}

/// One member of the cut, or a node above members.
#[derive(Clone, Debug, PartialEq)]
struct Node {
    key: SectionKey,
    /// Indices of what it is replaced by; a quarter without data has none.
    children: Option<[Option<u32>; 4]>,
    /// Pixels of a finest cell at its nearest point; not seen: none.
    nearness: Option<f64>,
}

/// The members of the quadtree that are to be seen, nodes above them included.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    nodes: Vec<Node>,
    roots: Vec<u32>,
}

/// A place, and what it shows: its own columns, or those of a coarser section around it, or of the sparse sample.
pub type Shown = (SectionKey, PayloadKey);

impl Domain {
    /// Of files that lie so on `grid`.
    pub fn new(grid: &Grid, extents: Vec<Extent>) -> Domain {
        let cell = grid.cell();
        let origin = grid.anchor.map(|cells| cells as f64 * cell);
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for extent in &extents {
            for axis in 0..2 {
                low[axis] = low[axis].min(extent.low[axis]);
                high[axis] = high[axis].max(extent.high[axis] - 1);
            }
        }
        let mut roots = Vec::new();
        if !extents.is_empty() {
            let across = |level: u8, axis: usize| {
                let shift = SECTION_LOG2 + u32::from(level);
                (low[axis] >> shift)..=(high[axis] >> shift)
            };
            let small = |level: &u8| (0..2).all(|axis| across(*level, axis).count() <= 2);
            let level = (0..MOST_LEVEL).find(small).unwrap_or(MOST_LEVEL);
            for j in across(level, 1) {
                roots.extend(across(level, 0).map(|i| SectionKey { level, i, j }));
            }
        }
        Domain { extents, roots, origin, cell }
    }

    /// The coarsest sections.
    pub fn roots(&self) -> &[SectionKey] {
        &self.roots
    }

    /// What is to be seen with `sight`. O(members · files near them).
    pub fn cut(&self, sight: &Sight) -> Cut {
        let mut cut = Cut::default();
        let all: Vec<u32> = (0..self.extents.len() as u32).collect();
        for &root in &self.roots {
            let node = self.refine(&mut cut, root, &all, sight);
            cut.roots.extend(node);
        }
        cut
    }

    fn refine(&self, cut: &mut Cut, key: SectionKey, near: &[u32], sight: &Sight) -> Option<u32> {
        let extent = |&index: &u32| &self.extents[index as usize];
        let here: Vec<u32> =
            near.iter().copied().filter(|e| key.touches(extent(e).low, extent(e).high)).collect();
        if here.is_empty() {
            return None;
        }
        // The box of what may be there, as shown.
        let side = |axis: usize| {
            let [first, end] = key.cells(axis);
            let low =
                here.iter().map(|e| i64::from(extent(e).low[axis])).min().map_or(first, |v| v.max(first));
            let high = here.iter().map(|e| i64::from(extent(e).high[axis])).max().map_or(end, |v| v.min(end));
            [low, high].map(|cells| self.origin[axis] + cells as f64 * self.cell)
        };
        let ([west, east], [south, north]) = (side(0), side(1));
        let top = here.iter().map(|e| extent(e).up[1]).fold(f64::NEG_INFINITY, f64::max);
        let bottom = here.iter().map(|e| extent(e).up[0]).fold(f64::INFINITY, f64::min);
        let place =
            |up: f64| [DVec3::new(west, south, sight.shown(up)), DVec3::new(east, north, sight.shown(top))];
        let halo = HALO * self.cell * f64::from(key.level).exp2();
        let [low, high] = place(bottom.min(sight.floor));
        let around = DVec3::new(halo, halo, 0.0);
        let seen = sight.sees(&[low - around, high + around]);
        let pixels = sight.pixels(self.cell, &place(bottom));
        let fine = pixels * f64::from(key.level).exp2() <= sight.detail;
        let index = cut.nodes.len() as u32;
        cut.nodes.push(Node { key, children: None, nearness: seen.then_some(pixels) });
        if key.level > 0 && seen && !fine && cut.nodes.len() < LIMITS.cut_nodes {
            let children: [Option<u32>; 4] =
                std::array::from_fn(|quarter| self.refine(cut, key.child(quarter as i32), &here, sight));
            cut.nodes[index as usize].children = Some(children);
        }
        Some(index)
    }
}

/// What there is to show at a node.
enum Found {
    /// These places are shown, and all others below are known to be empty.
    Some(Vec<Shown>),
    /// Nothing that is below is there.
    Missing,
}

impl Cut {
    fn members(&self) -> impl Iterator<Item = &Node> {
        self.nodes.iter().filter(|node| node.children.is_none())
    }

    /// Members that are seen, with the pixels that a finest cell covers there.
    pub fn wanted(&self) -> impl Iterator<Item = (SectionKey, f64)> {
        self.members().filter_map(|node| Some((node.key, node.nearness?)))
    }

    /// Nodes in all, those above members included.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is nothing at all.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Each place and what it shows now: a member itself where `live` knows it (`Some(false)`: it is known to be empty),
    /// else the nearest section around it that is, else the sparse sample.
    pub fn shown(&self, live: &dyn Fn(PayloadKey) -> Option<bool>) -> Vec<Shown> {
        let mut shown = Vec::new();
        for &root in &self.roots {
            let root_level = self.nodes[root as usize].key.level;
            match self.find(root, root_level, live) {
                Found::Some(found) => shown.extend(found),
                Found::Missing => {
                    let key = self.nodes[root as usize].key;
                    shown.extend(stand_in(key, root_level, live).map(|from| (key, from)));
                }
            }
        }
        shown
    }

    fn find(&self, index: u32, root_level: u8, live: &dyn Fn(PayloadKey) -> Option<bool>) -> Found {
        let node = &self.nodes[index as usize];
        let Some(children) = &node.children else {
            return match live(node.key.into()) {
                Some(true) => Found::Some(vec![(node.key, node.key.into())]),
                Some(false) => Found::Some(Vec::new()),
                None => Found::Missing,
            };
        };
        let found = children.iter().flatten().map(|&child| (child, self.find(child, root_level, live)));
        let (mut all, mut missing) = (Vec::new(), Vec::new());
        let mut some = false;
        for (child, found) in found {
            match found {
                Found::Some(found) => {
                    some = true;
                    all.extend(found);
                }
                Found::Missing => missing.push(self.nodes[child as usize].key),
            }
        }
        if !some {
            return Found::Missing;
        }
        all.extend(missing.into_iter().filter_map(|key| Some((key, stand_in(key, root_level, live)?))));
        Found::Some(all)
    }
}

/// The finest payload that is there and holds all of `key`: columns up to the level of the roots, above which nothing is
/// wanted any more, else the sparse sample, which is coarser.
fn stand_in(
    key: SectionKey,
    root_level: u8,
    live: &dyn Fn(PayloadKey) -> Option<bool>,
) -> Option<PayloadKey> {
    let around = || std::iter::successors(Some(key), |key| Some(key.parent()));
    let columns = around().take_while(|key| key.level <= root_level).map(PayloadKey::columns);
    let coarser = around().skip_while(|key| key.level <= root_level);
    let samples = coarser.take_while(|key| key.level <= sparse::COARSEST_LEVEL).map(PayloadKey::sample);
    columns.chain(samples).find(|&key| live(key) == Some(true))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::HEIGHT_STEP;
    use crate::section::PayloadKind;
    use std::collections::HashSet;

    fn grid() -> Grid {
        Grid { base_cell: 0.5, coarsen: 0, anchor: [1 << 20, 1 << 21], height_step: HEIGHT_STEP }
    }

    /// Sixteen tiles of 1,000 × 1,000 cells, 100 units high.
    fn domain() -> Domain {
        let tile = |i: i32, j: i32| Extent {
            low: [i * 1000, j * 1000],
            high: [i * 1000 + 1000, j * 1000 + 1000],
            up: [0.0, 100.0],
        };
        Domain::new(&grid(), (0..16).map(|k| tile(k % 4, k / 4)).collect())
    }

    /// An eye `up` units over cell (i, j) that sees everything to the east of it.
    fn sight(i: f64, j: f64, up: f64, detail: f64) -> Sight {
        let at = DVec3::new(i * 0.5 + (1 << 20) as f64 * 0.5, j * 0.5 + (1 << 21) as f64 * 0.5, up);
        Sight {
            planes: vec![(DVec3::X, at.x)],
            eye: Some(at),
            pixel: 0.006,
            z_scale: 1.0,
            pivot: 0.0,
            floor: -10.0,
            detail,
        }
    }

    fn area(key: SectionKey) -> i64 {
        1 << (2 * (SECTION_LOG2 + u32::from(key.level)))
    }

    #[test]
    fn roots_hold_everything() {
        let domain = domain();
        assert_eq!(domain.roots().len(), 4);
        assert_eq!(domain.roots()[0].level, 3);
        assert!(Domain::new(&grid(), Vec::new()).cut(&sight(0.0, 0.0, 9.0, 1.0)).is_empty());
    }

    #[test]
    fn members_cover_everything_once_and_are_as_fine_as_a_pixel() {
        let (domain, sight) = (domain(), sight(2000.0, 2000.0, 150.0, 1.0));
        let cut = domain.cut(&sight);
        let keys: Vec<_> = cut.members().map(|node| node.key).collect();
        for (n, a) in keys.iter().enumerate() {
            for b in &keys[n + 1..] {
                let [low, high] = [0, 1].map(|end| [0, 1].map(|axis| b.cells(axis)[end] as i32));
                assert!(!a.touches(low, high), "{a:?} {b:?}");
            }
        }
        let missing: i64 = domain.roots().iter().map(|&root| area(root)).sum::<i64>()
            - keys.iter().map(|&key| area(key)).sum::<i64>();
        // Only what no file touches.
        assert!(missing >= 0 && missing < 4 * area(domain.roots()[0]));
        for tile in &domain.extents {
            let covered: i64 = keys
                .iter()
                .filter(|key| key.touches(tile.low, tile.high))
                .map(|key| {
                    (0..2)
                        .map(|axis| {
                            let [a, b] = key.cells(axis);
                            b.min(tile.high[axis].into()) - a.max(tile.low[axis].into())
                        })
                        .product::<i64>()
                })
                .sum();
            assert_eq!(covered, 1_000_000);
        }
        assert_eq!(cut, domain.cut(&sight));
        let levels: HashSet<_> = cut.wanted().map(|(key, _)| key.level).collect();
        assert!(levels.len() > 2 && levels.contains(&0), "{levels:?}");
        for (key, pixels) in cut.wanted() {
            assert!(key.level == 0 || pixels * f64::from(key.level).exp2() <= 1.0);
        }
        // What is not seen is not refined for its own sake.
        let behind = |key: &SectionKey| key.cells(0)[1] <= 2000;
        assert!(cut.wanted().all(|(key, _)| !behind(&key)));
        assert!(keys.iter().any(behind));
        assert_eq!(domain.cut(&Sight { detail: 0.0, ..sight }).wanted().map(|(k, _)| k.level).max(), Some(0));
    }

    #[test]
    fn what_is_seen_moves_with_the_eye() {
        let by = DVec3::new(400.0 * 0.5, -70.0 * 0.5, 31.0);
        let moved = sight(2000.0, 2000.0, 150.0, 1.0).moved(by);
        assert_eq!(moved, sight(2400.0, 1930.0, 181.0, 1.0));
    }

    #[test]
    fn what_is_missing_shows_what_is_around_it() {
        let cut = domain().cut(&sight(2000.0, 2000.0, 150.0, 1.0));
        let members: Vec<_> = cut.members().map(|node| node.key).collect();
        let wanted: Vec<_> = cut.wanted().collect();
        let root = |key: PayloadKey| (key.section.level == 3).then_some(true);
        // Nothing but the roots: they are shown, each once.
        let shown = cut.shown(&root);
        assert!(
            shown.len() <= 4
                && shown.iter().all(|(at, from)| PayloadKey::columns(*at) == *from && at.level == 3)
        );
        // One member: it is shown, and the root in all other places, each place once.
        let one = wanted.iter().find(|(key, _)| key.level == 0).unwrap().0;
        let shown = cut.shown(&|key| if key == one.into() { Some(true) } else { root(key) });
        assert!(shown.contains(&(one, one.into())));
        // Columns coarser than the roots are of other files: nothing stands in for anything.
        assert!(
            cut.shown(&|key| (key.kind == PayloadKind::Columns && key.section.level == 5).then_some(true))
                .is_empty()
        );
        assert!(shown.iter().all(|(at, from)| *at == one || from.section.level == 3));
        let covered: i64 = shown.iter().map(|(at, _)| area(*at)).sum();
        let all: i64 = members.iter().map(|&key| area(key)).sum();
        assert_eq!(covered, all);
        // Everything, some of it empty.
        let empty: HashSet<_> = members.iter().copied().step_by(3).collect();
        let shown = cut.shown(&|key| Some(!empty.contains(&key.section)));
        assert_eq!(shown.len(), members.len() - empty.len());
        assert!(shown.iter().all(|(at, from)| PayloadKey::columns(*at) == *from));
        assert!(cut.shown(&|_| None).is_empty());
        // The sparse sample stands in where nothing else does, however fine it is.
        let sampled = |key: PayloadKey| {
            let of_sample = key.kind == PayloadKind::Sample && key.section.level == 9;
            if key == one.into() || of_sample { Some(true) } else { None }
        };
        let shown = cut.shown(&sampled);
        let is_sample = |(_, from): &&Shown| from.kind == PayloadKind::Sample;
        assert_eq!(shown.iter().filter(is_sample).count(), shown.len() - 1);
        assert!(shown.contains(&(one, one.into())));
        // Columns coarser than the roots are of other files: nothing stands in for anything.
        assert!(
            cut.shown(&|key| (key.kind == PayloadKind::Columns && key.section.level == 5).then_some(true))
                .is_empty()
        );
    }

    #[test]
    fn parallel_rays_have_one_size_of_pixel() {
        let parallel = Sight { eye: None, pixel: 2.0, planes: Vec::new(), ..sight(0.0, 0.0, 0.0, 1.0) };
        let cut = domain().cut(&parallel);
        assert!(cut.wanted().all(|(key, _)| key.level == 2));
    }
}
