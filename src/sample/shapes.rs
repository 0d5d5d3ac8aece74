//! What is framed of the whole and of each file, and the ground below it.

use super::frame::Framed;
use super::seen::Seen;
use super::shape::shape;
use super::weighted::Weighted;
use crate::coords::{Bounds, Hull, LowSurface};
use glam::DVec3;

/// What is framed, and the ground below it, roughly.
pub(super) type Shape = (Hull, LowSurface);

/// What shapes are made from.
pub(super) struct Shapes<'a> {
    pub sample: &'a Weighted<'a>,
    /// Of each file, by the points that are shown by default.
    pub framed: &'a [Framed],
    /// The box of the whole, by those.
    pub frame: Option<Bounds>,
    /// Files that are framed with the others.
    pub in_frame: &'a [usize],
    /// Files that are drawn.
    pub drawn: usize,
    /// Every point was seen.
    pub whole: bool,
}

impl Shapes<'_> {
    /// Of the points that are shown by default.
    pub fn of_all(&self, usual: &dyn Fn(&Seen) -> bool) -> (Option<Shape>, Vec<Option<Hull>>) {
        let hull = |(file, framed): (usize, &Framed)| {
            let points = self.kept(file, self.sample.placed(file, usual).map(|(point, _)| point));
            self.hull(file, framed.bounds, points)
        };
        self.with(self.framed.iter().enumerate().map(hull).collect(), usual)
    }

    /// Of others, which are `shown`; where not every point was seen, with all that may hold more of them.
    pub fn of_shown(
        &self,
        usual: &dyn Fn(&Seen) -> bool,
        shown: &dyn Fn(&Seen) -> bool,
    ) -> (Option<Shape>, Vec<Option<Hull>>) {
        let hull = |(file, framed): (usize, &Framed)| {
            let points = match (self.whole, framed.bounds) {
                (false, Some(bounds)) => self.sample.may_hold(file, &bounds, usual, shown),
                _ => self.sample.placed(file, shown).map(|(point, _)| point).collect(),
            };
            let points = self.kept(file, points.into_iter());
            let bounds = Bounds::around(&points).zip(framed.bounds).and_then(|(own, all)| own.within(all));
            self.hull(file, bounds, points)
        };
        self.with(self.framed.iter().enumerate().map(hull).collect(), shown)
    }

    /// Points that do not lie far from the others of their file.
    fn kept(&self, file: usize, points: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
        points.filter(|point| self.framed[file].keeps(*point)).collect()
    }

    fn hull(&self, file: usize, bounds: Option<Bounds>, points: Vec<DVec3>) -> Option<Hull> {
        bounds.map(|bounds| shape(&bounds, points.into_iter(), self.drawn, self.sample.seen(file)))
    }

    /// The ground below `hulls`, one a file: that of the points that are `shown`.
    fn with(
        &self,
        hulls: Vec<Option<Hull>>,
        shown: &dyn Fn(&Seen) -> bool,
    ) -> (Option<Shape>, Vec<Option<Hull>>) {
        let whole = Hull::union(self.in_frame.iter().filter_map(|&file| hulls[file].as_ref()));
        let of_file = |file| self.kept(file, self.sample.placed(file, shown).map(|(point, _)| point));
        let points: Vec<DVec3> = (0..self.framed.len()).flat_map(of_file).collect();
        let nowhere = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
        let low = LowSurface::of(&whole.as_ref().map_or(nowhere, Hull::bounds), &points);
        let above = |hull: Hull| hull.above(&low);
        let hulls = hulls.into_iter().map(|hull| hull.map(above)).collect();
        let whole = self.frame.as_ref().map(|frame| whole.map_or_else(|| frame.into(), above));
        (whole.map(|whole| (whole, low)), hulls)
    }
}
