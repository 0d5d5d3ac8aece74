//! Bounds that hold the data and not the stray points, and the ground that boxes cover.

use super::quantile::quantile;
use crate::coords::Bounds;
use crate::source::crs::Unit;
use crate::text::tidy;
use glam::{DVec2, DVec3};

/// Share of a file's sample that may lie outside on either side of an axis.
const STRAY: f64 = 0.002;
/// With fewer points the sample cannot tell a stray point from the file's edge.
pub(super) const ENOUGH: usize = 30;

/// A file whose sample is spread all over it reaches at most this much beyond it, in widths of the sample.
pub(super) const WELL_SEEN: f64 = 0.5;
/// And one of which a few runs of neighbouring points were seen.
pub(super) const SEEN_IN_PARTS: f64 = 3.0;

/// A gap so many times as long as all that lies on both sides of it parts places that have nothing to do with each
/// other.
const FAR: f64 = 8.0;
/// Share of a file's points below which a place that is far from the others is not framed.
const FEW: f64 = 0.01;
/// Fewer points than this are no place that something else could be far from.
const A_PLACE: usize = 8;
/// Places that are looked for in a file.
const MOST_PLACES: usize = 16;

/// Whether one of `points` lies in `bounds`, or there is none.
pub(super) fn holds_some(bounds: Bounds, points: &[(DVec3, f64)]) -> bool {
    let inside = |point: DVec3| point.cmpge(bounds.min).all() && point.cmple(bounds.max).all();
    points.is_empty() || points.iter().any(|(point, _)| inside(*point))
}

/// What of one file is framed.
#[derive(Clone, Debug, Default)]
pub struct Framed {
    /// The box; `None` for no points.
    pub bounds: Option<Bounds>,
    /// What is left out of it because it lies far away.
    pub left_out: Option<LeftOut>,
    /// How far two places are apart that both count.
    pub apart: Option<f64>,
    /// Axis, and the values on it that count.
    cuts: Vec<(usize, [f64; 2])>,
}

/// Points that are few and lie far from the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// How many they are: what those that were seen stand for.
    pub points: f64,
    /// Their share in all points of the file.
    pub share: f64,
    /// How many were seen.
    pub seen: usize,
    /// Where they all lie, if that is one place.
    pub spot: Option<DVec3>,
    /// Distance on the ground from the box to the nearest.
    pub distance: f64,
}

impl Framed {
    /// Of a file whose header has `header`; `points` with weights, in world coordinates, hidden points left out; `beyond` as in
    /// [`file_bounds`].
    ///
    /// Where the points lie at two places with a [`FAR`] gap between, one of them is left out if it holds [`FEW`]
    /// points, or less than half of them at one E, N: such are points without a position, most often at 0, 0.
    pub fn of(header: Option<Bounds>, points: &[(DVec3, f64)], beyond: f64) -> Framed {
        let mut framed = Framed::default();
        let mut kept = points.to_vec();
        let total: f64 = points.iter().map(|(_, weight)| weight).sum();
        while framed.cuts.len() < MOST_PLACES
            && let Some(gap) = largest_gap(&kept, 0.0).or_else(|| largest_gap(&kept, STRAY))
        {
            let (low, high): (Vec<_>, Vec<_>) =
                kept.iter().copied().partition(|(point, _)| point[gap.axis] < gap.middle);
            let weight = |part: &[(DVec3, f64)]| part.iter().map(|(_, weight)| weight).sum::<f64>();
            let is_low = weight(&low) < weight(&high);
            let (lesser, main) = if is_low { (low, high) } else { (high, low) };
            let is_little = weight(&lesser) < FEW * total
                || spot(&lesser).is_some() && spot(&main).is_none() && weight(&lesser) < 0.5 * total;
            if main.len() < A_PLACE || !is_little {
                if lesser.len() >= A_PLACE {
                    framed.apart = Some(gap.length);
                }
                break;
            }
            let side = if is_low { [gap.middle, f64::INFINITY] } else { [f64::NEG_INFINITY, gap.middle] };
            framed.cuts.push((gap.axis, side));
            kept = main;
        }
        framed.bounds = file_bounds(header, &kept, beyond);
        let Some(bounds) = framed.bounds else { return framed };
        let off = |point: DVec3| (bounds.min - point).max(point - bounds.max).truncate().max(DVec2::ZERO);
        let reach = FAR * bounds.size().truncate().max_element();
        let is_far = |point: DVec3| kept.len() >= A_PLACE && off(point).max_element() > reach.max(1e-9);
        let (far, near): (Vec<_>, Vec<_>) =
            points.iter().copied().partition(|(p, _)| !framed.keeps(*p) || is_far(*p));
        if !far.is_empty() {
            framed.bounds =
                file_bounds(header.and_then(|header| without(header, &far, &near)), &near, beyond);
            let left: f64 = far.iter().map(|(_, weight)| weight).sum();
            framed.left_out = Some(LeftOut {
                points: left,
                share: left / total,
                seen: far.len(),
                spot: spot(&far),
                distance: far.iter().map(|(point, _)| off(*point).length()).fold(f64::INFINITY, f64::min),
            });
        }
        framed
    }

    /// Whether a point is not one of those that were left out as a place of their own.
    pub fn keeps(&self, point: DVec3) -> bool {
        self.cuts.iter().all(|(axis, [low, high])| (*low..*high).contains(&point[*axis]))
    }
}

/// A header without the heights that it owes to `far` points: there it is as the `near` ones are.
fn without(header: Bounds, far: &[(DVec3, f64)], near: &[(DVec3, f64)]) -> Option<Bounds> {
    let range = |points: &[(DVec3, f64)]| {
        let heights = points.iter().map(|(point, _)| point.z);
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], z| [z.min(lo), z.max(hi)])
    };
    let ([far_low, far_high], [low, high]) = (range(far), range(near));
    let min = if far_low < low { low } else { header.min.z };
    let max = if far_high > high { high } else { header.max.z };
    Bounds::new(header.min.with_z(min), header.max.with_z(max))
}

/// The one E, N of all `points`, if there is one.
fn spot(points: &[(DVec3, f64)]) -> Option<DVec3> {
    let first = points.first()?.0;
    points.iter().all(|(point, _)| point.truncate() == first.truncate()).then_some(first)
}

/// A gap between places.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Gap {
    /// 0: it lies from west to east.
    axis: usize,
    length: f64,
    middle: f64,
}

/// The longest [`FAR`] gap in `points`, this share of them left out of account at each end: strays may lie within what
/// is a gap otherwise. O(n).
fn largest_gap(points: &[(DVec3, f64)], stray: f64) -> Option<Gap> {
    let strays = (stray * points.len() as f64) as usize;
    let on_axis = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|(point, _)| point[axis]).collect();
        let last = values.len().checked_sub(1 + strays)?;
        let low = *values.select_nth_unstable_by(strays, f64::total_cmp).1;
        let high = *values.select_nth_unstable_by(last, f64::total_cmp).1;
        // Such a gap leaves nothing but the ends.
        let end = (high - low) / (FAR + 1.0);
        let (mut west, mut east) = (low, high);
        for value in values {
            if value < low || value > high {
                continue;
            }
            if value <= low + end {
                west = west.max(value);
            } else if value >= high - end {
                east = east.min(value);
            } else {
                return None;
            }
        }
        let length = east - west;
        let is_far = length > FAR * (high - low - length) && length > 0.0;
        is_far.then_some(Gap { axis, length, middle: west + 0.5 * length })
    };
    let gaps = [on_axis(0), on_axis(1)];
    gaps.into_iter().flatten().max_by(|a, b| a.length.total_cmp(&b.length).then(b.axis.cmp(&a.axis)))
}

/// The gap between the files' boxes on the ground, where they lie at two places with a [`FAR`] one between.
fn apart(boxes: &[Bounds]) -> Option<Gap> {
    let on_axis = |axis: usize| {
        let mut ends: Vec<[f64; 2]> = boxes.iter().map(|b| [b.min[axis], b.max[axis]]).collect();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let first = ends.first()?[0];
        let (mut end, mut longest) = (first, Gap { axis, length: 0.0, middle: first });
        for [from, to] in ends {
            if from - end > longest.length {
                longest = Gap { axis, length: from - end, middle: 0.5 * (from + end) };
            }
            end = end.max(to);
        }
        let length = longest.length;
        (length > FAR * (end - first - length) && length > 0.0).then_some(longest)
    };
    let gaps = [on_axis(0), on_axis(1)];
    gaps.into_iter().flatten().max_by(|a, b| a.length.total_cmp(&b.length).then(b.axis.cmp(&a.axis)))
}

/// A header that begins at 0, 0, far from all points that were seen: some points lie there that have no position.
fn begins_nowhere(header: Bounds, points: &[(DVec3, f64)]) -> bool {
    let corner = header.min.truncate();
    let far = header.max.truncate() * 0.9;
    corner == DVec2::ZERO && !points.is_empty() && points.iter().all(|(p, _)| p.truncate().cmpgt(far).all())
}

/// The box of one file: each side as its header has it, where the sample bears that out; else as far as
/// the sample reaches without stray points. `points` with weights; hidden points left out; `beyond`: how far a side may lie
/// beyond them, in their widths ([`WELL_SEEN`] or [`SEEN_IN_PARTS`]).
pub fn file_bounds(header: Option<Bounds>, points: &[(DVec3, f64)], beyond: f64) -> Option<Bounds> {
    if points.len() < ENOUGH
        && let Some(header) = header
        && !begins_nowhere(header, points)
    {
        return Some(header);
    }
    let header = header.filter(|header| points.len() >= ENOUGH || !begins_nowhere(*header, points));
    let core = |axis: usize| {
        let mut values: Vec<(f64, f64)> =
            points.iter().map(|(point, weight)| (point[axis], *weight)).collect();
        Some((quantile(&mut values, STRAY)?, quantile(&mut values, 1.0 - STRAY)?))
    };
    let cores = [core(0)?, core(1)?, core(2)?];
    let width = |axis: usize| cores[axis].1 - cores[axis].0;
    let least = 1e-6 * width(0).max(width(1)).max(width(2));
    let (mut min, mut max) = (DVec3::ZERO, DVec3::ZERO);
    for axis in 0..3 {
        let (lo, hi) = cores[axis];
        // A tower or a shaft reaches far out of flat country, but not kilometres.
        let aside = if axis == 2 { 0.5 * width(0).max(width(1)) } else { 0.0 };
        let reach =
            if points.len() < ENOUGH { f64::MAX } else { (beyond * width(axis)).max(aside).max(least) };
        let near = |value: f64| (lo - reach..=hi + reach).contains(&value);
        let inside = points.iter().map(|(point, _)| point[axis]).filter(|&value| near(value));
        let (first, last) = inside.fold((lo, hi), |(first, last), value| (value.min(first), value.max(last)));
        let side = |value: Option<f64>| value.filter(|&value| near(value));
        // A header that leaves out points is no better than the sample.
        min[axis] = side(header.map(|header| header.min[axis])).map_or(first, |value| value.min(first));
        max[axis] = side(header.map(|header| header.max[axis])).map_or(last, |value| value.max(last));
    }
    Bounds::new(min, max)
}

/// What is not obvious about what is framed.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameNote {
    /// Points of a file that are not framed.
    LeftOut {
        /// The file.
        file: usize,
        /// Which points.
        points: LeftOut,
        /// Every point of the file was seen.
        exact: bool,
    },
    /// Files that are not framed.
    FarFiles {
        /// Which.
        files: Vec<usize>,
        /// From the others to the nearest of them, on the ground, world units.
        distance: f64,
    },
    /// Two places are framed, far from each other.
    Apart {
        /// Those at the one with fewer files; none: a file lies at both.
        files: Vec<usize>,
        /// From one to the other, world units.
        distance: f64,
    },
}

impl FrameNote {
    /// The file that it is about, if that is one.
    pub fn file(&self) -> Option<usize> {
        match self {
            FrameNote::LeftOut { file, .. } => Some(*file),
            _ => None,
        }
    }

    /// The files that it is about, where those are to be named behind it.
    pub fn files(&self) -> &[usize] {
        match self {
            FrameNote::FarFiles { files, .. } | FrameNote::Apart { files, .. } => files,
            FrameNote::LeftOut { .. } => &[],
        }
    }

    /// Whether something is wrong with the data.
    pub fn is_warning(&self) -> bool {
        !matches!(self, FrameNote::Apart { files, .. } if files.is_empty())
    }

    /// In words; `unit` is that of world coordinates.
    pub fn words(&self, unit: Option<&Unit>) -> String {
        let far = |distance: f64| {
            let metres = unit.filter(|unit| unit.si == 1.0);
            match metres {
                Some(_) if distance >= 10_000.0 => format!("{:.0} km", distance / 1000.0),
                _ => format!("{distance:.0} {}", unit.map_or("units", Unit::symbol)),
            }
        };
        match self {
            FrameNote::LeftOut { points, exact, .. } => {
                let LeftOut { points, share, seen, spot, distance } = points;
                let count = match exact {
                    true if *seen == 1 => "1 point".to_owned(),
                    true => format!("{seen} points"),
                    // A handful says little of how many there are.
                    false if *seen < A_PLACE => "some points".to_owned(),
                    false => format!("about {points:.0} points"),
                };
                let percent = 100.0 * share;
                let share = if percent >= 0.05 { format!(" ({percent:.1} %)") } else { String::new() };
                let at = spot.map_or(String::new(), |at| format!(" at {}, {}", tidy(at.x), tidy(at.y)));
                let far = far(*distance);
                let verb = if *exact && *seen == 1 { "is" } else { "are" };
                format!("{count}{share}{at}, {far} from the others, {verb} not framed")
            }
            FrameNote::FarFiles { files, distance } => {
                let far = far(*distance);
                match files.len() {
                    1 => format!("1 file with next to no points, {far} from the others, is not framed"),
                    n => format!("{n} files with next to no points, {far} from the others, are not framed"),
                }
            }
            FrameNote::Apart { distance, .. } => {
                format!(
                    "the data lies at places {} apart: with all of it framed, each is small",
                    far(*distance)
                )
            }
        }
    }
}

/// The box of the whole, the files in it, and what is to be said of it. `points`: of a file; `exact`: every point was seen.
pub fn whole(
    files: &[Framed],
    points: impl Fn(usize) -> u64,
    exact: bool,
) -> (Option<Bounds>, Vec<usize>, Vec<FrameNote>) {
    let boxes: Vec<(usize, Bounds)> =
        files.iter().enumerate().filter_map(|(file, framed)| Some((file, framed.bounds?))).collect();
    let sized: Vec<(Bounds, u64)> = boxes.iter().map(|&(file, bounds)| (bounds, points(file))).collect();
    let (whole, far_off) = whole_bounds(&sized);
    let mut notes: Vec<FrameNote> = files
        .iter()
        .enumerate()
        .filter_map(|(file, framed)| Some(FrameNote::LeftOut { file, points: framed.left_out?, exact }))
        .collect();
    if let Some(whole) = whole
        && !far_off.is_empty()
    {
        let off = |b: Bounds| (whole.min - b.max).max(b.min - whole.max).truncate().max(DVec2::ZERO).length();
        let distance = far_off.iter().map(|&at| off(boxes[at].1)).fold(f64::INFINITY, f64::min);
        let files = far_off.iter().map(|&at| boxes[at].0).collect();
        notes.push(FrameNote::FarFiles { files, distance });
    }
    let framed = (0..boxes.len()).filter(|at| !far_off.contains(at));
    let (in_it, framed): (Vec<usize>, Vec<Bounds>) = framed.map(|at| boxes[at]).unzip();
    let within = files.iter().filter_map(|framed| framed.apart).reduce(f64::max);
    let between = apart(&framed);
    match (within, between) {
        (within, Some(gap)) if within.is_none_or(|distance| distance <= gap.length) => {
            let is_low = |bounds: &Bounds| bounds.center()[gap.axis] < gap.middle;
            let (low, high): (Vec<_>, Vec<_>) = in_it.iter().zip(&framed).partition(|(_, b)| is_low(b));
            let fewer = if low.len() < high.len() { low } else { high };
            let files = fewer.into_iter().map(|(file, _)| *file).collect();
            notes.push(FrameNote::Apart { files, distance: gap.length });
        }
        (Some(distance), _) => notes.push(FrameNote::Apart { files: Vec::new(), distance }),
        (None, _) => {}
    }
    (whole, in_it, notes)
}

/// The box of the whole: of all files but those that lie far off and hold next to nothing (under 0.1 %
/// of the points together); and which those are.
pub fn whole_bounds(files: &[(Bounds, u64)]) -> (Option<Bounds>, Vec<usize>) {
    let total: u64 = files.iter().map(|(_, points)| points).sum();
    let by_size = {
        let mut order: Vec<usize> = (0..files.len()).collect();
        order.sort_by_key(|&index| (std::cmp::Reverse(files[index].1), index));
        order
    };
    let (mut whole, mut far_off): (Option<Bounds>, _) = (None, Vec::new());
    let mut held = 0;
    for index in by_size {
        let (bounds, points) = files[index];
        whole = Some(match whole {
            None => bounds,
            Some(whole) => {
                let off = (whole.min - bounds.max).max(bounds.min - whole.max).max_element();
                let far = off > 2.0 * whole.size().max_element();
                let nothing = (total - held) as f64 <= 0.001 * total as f64;
                if far && nothing {
                    far_off.push(index);
                    whole
                } else {
                    whole.union(bounds)
                }
            }
        });
        held += points;
    }
    (whole, far_off)
}

/// Ground that the boxes cover together, square units; O(n²) for n boxes.
pub fn covered_area(boxes: &[Bounds]) -> f64 {
    let mut edges: Vec<f64> = boxes.iter().flat_map(|b| [b.min.x, b.max.x]).collect();
    edges.sort_by(f64::total_cmp);
    edges.dedup();
    let mut by_south: Vec<&Bounds> = boxes.iter().collect();
    by_south.sort_by(|a, b| a.min.y.total_cmp(&b.min.y));
    let mut area = 0.0;
    for slab in edges.windows(2) {
        let (mut length, mut end) = (0.0, f64::MIN);
        for b in by_south.iter().filter(|b| b.min.x <= slab[0] && b.max.x >= slab[1]) {
            length += (b.max.y - b.min.y.max(end)).max(0.0);
            end = end.max(b.max.y);
        }
        area += length * (slab[1] - slab[0]);
    }
    area
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(min: [f64; 3], max: [f64; 3]) -> Bounds {
        Bounds::new(min.into(), max.into()).unwrap()
    }

    fn grid(side: i32, z: f64) -> Vec<(DVec3, f64)> {
        let at = |i: i32, j: i32| DVec3::new(i.into(), j.into(), z + f64::from(i % 7));
        (0..side).flat_map(|i| (0..side).map(move |j| (at(i, j), 1.0))).collect()
    }

    #[test]
    fn a_sound_header_is_taken_to_the_digit() {
        let header = bounds([-0.5, -0.25, 1.0], [99.75, 99.5, 50.0]);
        assert_eq!(file_bounds(Some(header), &grid(100, 2.0), WELL_SEEN), Some(header));
        assert_eq!(file_bounds(Some(header), &[], WELL_SEEN), Some(header));
        assert_eq!(file_bounds(None, &[], WELL_SEEN), None);
    }

    #[test]
    fn stray_points_and_wrong_headers_are_seen_through() {
        let header = bounds([-0.5, -0.25, -175_000.0], [185_000.0, 99.5, 50.0]);
        let mut points = grid(100, 2.0);
        points.push((DVec3::new(185_000.0, 50.0, -175_000.0), 1.0));
        let found = file_bounds(Some(header), &points, WELL_SEEN).unwrap();
        assert_eq!((found.min, found.max), (DVec3::new(-0.5, -0.25, 2.0), DVec3::new(99.0, 99.5, 50.0)));
        let small = bounds([10.0, 10.0, 3.0], [20.0, 20.0, 3.5]);
        let found = file_bounds(Some(small), &grid(100, 2.0), WELL_SEEN).unwrap();
        assert_eq!((found.min.x, found.max.x, found.max.z), (0.0, 99.0, 8.0));
    }

    #[test]
    fn a_far_file_counts_unless_it_is_nothing() {
        let here = bounds([0.0; 3], [1000.0, 1000.0, 10.0]);
        let far = bounds([185_000.0, 0.0, 0.0], [186_000.0, 10.0, 1.0]);
        assert_eq!(whole_bounds(&[(here, 1_000_000), (far, 500)]), (Some(here), vec![1]));
        assert_eq!(whole_bounds(&[(here, 1_000_000), (far, 100_000)]), (Some(here.union(far)), vec![]));
        assert_eq!(whole_bounds(&[]), (None, vec![]));
        assert_eq!(apart(&[far, here]).map(|gap| gap.length), Some(184_000.0));
        assert_eq!(apart(&[here, here]), None);
        assert_eq!(apart(&[]), None);
        let beside = bounds([6000.0, 0.0, 0.0], [7000.0, 1000.0, 1.0]);
        assert_eq!(apart(&[here, beside]), None);
    }

    /// Points in UTM, `share` of them at 0, 0, 0.
    fn with_zeros(share: f64) -> Vec<(DVec3, f64)> {
        let mut points: Vec<_> =
            grid(100, 2.0).iter().map(|(p, w)| (*p + DVec3::new(512_000.0, 5_402_900.0, 0.0), *w)).collect();
        let zeros = (points.len() as f64 * share / (1.0 - share)) as usize;
        // Anywhere among the others.
        (0..zeros).for_each(|k| points.insert(k * 7919 % points.len(), (DVec3::ZERO, 1.0)));
        points
    }

    #[test]
    fn points_without_a_position_are_left_out_and_counted() {
        let header = bounds([0.0; 3], [512_099.0, 5_402_999.0, 8.0]);
        let sound = Framed::of(None, &with_zeros(0.0), WELL_SEEN);
        assert_eq!((sound.left_out, sound.apart), (None, None));
        for share in [0.0002, 0.004, 0.05, 0.3, 0.45] {
            let points = with_zeros(share);
            let zeros = points.len() - 10_000;
            let framed = Framed::of(Some(header), &points, WELL_SEEN);
            assert_eq!(framed.bounds, sound.bounds, "{share}");
            let left = framed.left_out.unwrap();
            assert_eq!((left.points, left.seen, left.spot), (zeros as f64, zeros, Some(DVec3::ZERO)));
            assert!((5.42e6..5.43e6).contains(&left.distance), "{left:?}");
            assert!(!framed.keeps(DVec3::ZERO) || share < STRAY);
            assert!(framed.keeps(DVec3::new(512_000.0, 5_402_950.0, 3.0)));
        }
        // With strays beside them.
        let mut points = with_zeros(0.05);
        points.push((DVec3::new(250_000.0, 9e6, 0.0), 1.0));
        let framed = Framed::of(Some(header), &points, WELL_SEEN);
        assert_eq!(framed.bounds, sound.bounds);
        assert_eq!(framed.left_out.map(|left| (left.seen, left.spot)), Some((527, None)));
        // A few points of a file, all of them right: the header is not.
        let few: Vec<_> = with_zeros(0.0).into_iter().step_by(4000).collect();
        let found = Framed::of(Some(header), &few, WELL_SEEN).bounds.unwrap();
        assert!(found.min.x >= 512_000.0 && found.min.y >= 5_402_900.0, "{found:?}");
    }

    #[test]
    fn two_places_are_framed_and_a_handful_of_points_far_off_is_not() {
        let place = |side: i32, east: f64| {
            grid(side, 2.0).into_iter().map(move |(p, w)| (p + DVec3::new(east, 0.0, 0.0), w))
        };
        let both: Vec<_> = place(100, 0.0).chain(place(50, 185_000.0)).collect();
        let framed = Framed::of(None, &both, WELL_SEEN);
        assert_eq!(framed.bounds.unwrap().size().x, 185_049.0);
        assert_eq!((framed.left_out, framed.apart), (None, Some(184_901.0)));
        let few: Vec<_> = place(100, 0.0).chain(place(8, 185_000.0)).collect();
        let framed = Framed::of(None, &few, WELL_SEEN);
        assert_eq!(framed.bounds.unwrap().size().x, 99.0);
        assert_eq!(
            framed.left_out.map(|left| (left.seen, left.spot, left.distance)),
            Some((64, None, 184_901.0))
        );
        // A gap between fields is none.
        let near: Vec<_> = place(100, 0.0).chain(place(9, 400.0)).collect();
        assert_eq!(Framed::of(None, &near, WELL_SEEN).bounds.unwrap().size().x, 408.0);
    }

    #[test]
    fn few_points_are_framed_whole() {
        let points: Vec<_> =
            (0..20).map(|k| (DVec3::new(f64::from(k * k), f64::from(19 - k), 0.0), 1.0)).collect();
        for count in 1..=20 {
            let framed = Framed::of(None, &points[..count], WELL_SEEN);
            let bounds = framed.bounds.unwrap();
            assert!(
                points[..count].iter().all(|(p, _)| p.cmpge(bounds.min).all() && p.cmple(bounds.max).all())
            );
            assert_eq!((framed.left_out, framed.apart), (None, None), "{count}");
        }
    }

    #[test]
    fn overlaps_are_counted_once() {
        let a = bounds([0.0; 3], [10.0, 10.0, 1.0]);
        let b = bounds([5.0, 5.0, 0.0], [15.0, 15.0, 1.0]);
        let c = bounds([20.0, 0.0, 0.0], [30.0, 1.0, 1.0]);
        assert_eq!(covered_area(&[a, b, c, a]), 100.0 + 75.0 + 10.0);
        assert_eq!(covered_area(&[]), 0.0);
    }
}
