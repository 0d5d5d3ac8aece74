//! The things that stand in the town, each as an exact shape. Lengths are metres, x east, y north.

use super::random::grain;

/// An sRGB colour, 0 to 1.
pub type Rgb = [f32; 3];

/// A rectangle on the ground: centre, direction of its long axis, half length and half width.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub centre: [f64; 2],
    /// Unit vector along the long axis.
    pub axis: [f64; 2],
    /// Half extent along and across the axis.
    pub half: [f64; 2],
}

impl Frame {
    /// (x, y) in the rectangle's own coordinates: along, across.
    #[inline]
    pub fn local(&self, x: f64, y: f64) -> [f64; 2] {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        [dx * self.axis[0] + dy * self.axis[1], dy * self.axis[0] - dx * self.axis[1]]
    }

    /// The place with own coordinates (along, across).
    pub fn world(&self, along: f64, across: f64) -> [f64; 2] {
        [
            self.centre[0] + along * self.axis[0] - across * self.axis[1],
            self.centre[1] + along * self.axis[1] + across * self.axis[0],
        ]
    }

    /// The same rectangle turned by 90°, moved in its own coordinates, with other extents.
    pub fn turned(&self, along: f64, across: f64, half: [f64; 2]) -> Frame {
        Frame { centre: self.world(along, across), axis: [-self.axis[1], self.axis[0]], half }
    }

    /// The same direction, moved in its own coordinates, with other extents.
    pub fn moved(&self, along: f64, across: f64, half: [f64; 2]) -> Frame {
        Frame { centre: self.world(along, across), axis: self.axis, half }
    }

    /// Own coordinates of (x, y) where it lies inside.
    #[inline]
    pub fn inside(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let p = self.local(x, y);
        (p[0].abs() <= self.half[0] && p[1].abs() <= self.half[1]).then_some(p)
    }

    fn bounds(&self) -> [f64; 4] {
        let ex = (self.axis[0] * self.half[0]).abs() + (self.axis[1] * self.half[1]).abs();
        let ey = (self.axis[1] * self.half[0]).abs() + (self.axis[0] * self.half[1]).abs();
        [self.centre[0] - ex, self.centre[1] - ey, self.centre[0] + ex, self.centre[1] + ey]
    }
}

/// How a roof rises from its eaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RoofShape {
    /// Ridge along the frame's axis.
    Gable,
    /// Ridge along the axis, sloped ends.
    Hip,
    /// A parapet around a plane.
    Flat,
    /// Four faces to one point.
    Pyramid,
    /// One plane, low on the negative side.
    Shed,
}

/// One part of a building's roof, overhang included. There is no wall: below the eaves is nothing.
#[derive(Clone, Copy, Debug)]
pub struct Roof {
    pub frame: Frame,
    pub shape: RoofShape,
    /// Absolute height of the eaves.
    pub eaves: f64,
    /// From the eaves to the highest point.
    pub rise: f64,
    pub color: Rgb,
    /// Solar panels on the southern or western side.
    pub panels: bool,
}

impl Roof {
    /// Height above (x, y), if the roof covers it.
    #[inline]
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let [along, across] = self.frame.inside(x, y)?;
        let [a, b] = self.frame.half;
        Some(match self.shape {
            RoofShape::Gable => self.eaves + self.rise * (1.0 - across.abs() / b),
            RoofShape::Hip => self.eaves + self.rise / b * (b - across.abs()).min(a - along.abs()),
            RoofShape::Pyramid => self.eaves + self.rise * (1.0 - (along.abs() / a).max(across.abs() / b)),
            RoofShape::Shed => self.eaves + self.rise * (across + b) / (2.0 * b),
            RoofShape::Flat if b - across.abs() < 0.35 || a - along.abs() < 0.35 => self.eaves + 0.5,
            RoofShape::Flat => self.eaves,
        })
    }

    /// Its colour at (x, y), which it covers.
    pub fn shade(&self, x: f64, y: f64) -> Rgb {
        let [along, across] = self.frame.local(x, y);
        let [a, b] = self.frame.half;
        // Which way the surface falls, as a world vector, against a southern sun.
        let fall_across = self.frame.axis[0] * across.signum();
        let fall_along = self.frame.axis[1] * along.signum();
        let south = match self.shape {
            RoofShape::Flat => 0.0,
            RoofShape::Gable => -fall_across,
            RoofShape::Shed => self.frame.axis[0],
            RoofShape::Hip if a - along.abs() < b - across.abs() => -fall_along,
            RoofShape::Pyramid if along.abs() / a > across.abs() / b => -fall_along,
            RoofShape::Hip | RoofShape::Pyramid => -fall_across,
        };
        if self.panels
            && south > 0.0
            && across.abs() > 0.18 * b
            && across.abs() < 0.8 * b
            && along.abs() < 0.7 * a
        {
            return [0.13, 0.16, 0.24];
        }
        let patina = 0.05 * grain(11, x * 0.45, y * 0.45) + 0.035 * grain(12, x * 2.3, y * 2.3);
        let light = (1.0 + 0.09 * south + patina) as f32;
        self.color.map(|c| c * light)
    }
}

/// The habit of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Habit {
    /// A rounded crown.
    Broad,
    /// A cone.
    Conifer,
    /// A column.
    Poplar,
    /// A bush down to the ground.
    Shrub,
}

/// A tree or bush.
#[derive(Clone, Copy, Debug)]
pub struct Tree {
    pub centre: [f64; 2],
    /// Absolute height of its foot.
    pub foot: f64,
    /// From foot to top.
    pub height: f64,
    pub radius: f64,
    pub habit: Habit,
    pub color: Rgb,
    pub salt: u32,
}

/// Where a pulse enters a crown.
#[derive(Clone, Copy, Debug)]
pub struct Crown {
    /// Absolute height of the leaves' outer surface.
    pub top: f64,
    /// Absolute height of the crown's lower end.
    pub bottom: f64,
    /// 1 on the sunny top, towards 0 in the shade and at the edge.
    pub light: f64,
}

impl Tree {
    /// The crown above (x, y), if it reaches there.
    #[inline]
    pub fn crown(&self, x: f64, y: f64) -> Option<Crown> {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        let square = dx * dx + dy * dy;
        let reach = self.radius * 1.12;
        if square > reach * reach {
            return None;
        }
        // Branches: the outline and the surface are lumpy at the scale of a metre or less.
        let lumps = grain(self.salt, x * 0.95, y * 0.95);
        let fine = grain(self.salt ^ 77, x * 2.7, y * 2.7);
        let r = square.sqrt() / (self.radius * (1.0 + 0.12 * lumps));
        if r >= 1.0 {
            return None;
        }
        let (profile, depth) = match self.habit {
            Habit::Broad => ((1.0 - r * r).sqrt(), 0.62),
            Habit::Conifer => (1.0 - 0.93 * r, 0.88),
            Habit::Poplar => ((1.0 - r * r * r).max(0.0), 0.85),
            Habit::Shrub => ((1.0 - r * r * r * r).sqrt(), 0.9),
        };
        let crown = self.height * depth;
        let rough = (0.09 * lumps + 0.05 * fine) * crown.min(5.0);
        let lowest = self.foot + self.height - crown;
        let top = (lowest + crown * (0.18 + 0.82 * profile) + rough).min(self.foot + self.height);
        let sunny = (-dy * 0.8 + dx * 0.6) / self.radius;
        let light = (0.5 + 0.32 * profile + 0.2 * sunny * r + 0.22 * lumps + 0.14 * fine).clamp(0.0, 1.0);
        Some(Crown { top, bottom: lowest.min(top), light })
    }
}

/// A body with a box-like top: hedge or car.
#[derive(Clone, Copy, Debug)]
pub struct Slab {
    pub frame: Frame,
    /// Absolute height of its foot.
    pub foot: f64,
    pub height: f64,
    pub color: Rgb,
    pub kind: SlabKind,
}

/// What a [`Slab`] is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SlabKind {
    /// Clipped bushes.
    Hedge,
    /// A car: bonnet, cabin, boot.
    Car,
}

impl Slab {
    /// Height of the top above (x, y), if it covers it.
    #[inline]
    pub fn top(&self, x: f64, y: f64) -> Option<f64> {
        let [along, _] = self.frame.inside(x, y)?;
        Some(match self.kind {
            SlabKind::Hedge => self.foot + self.height * (1.0 + 0.12 * grain(31, x * 2.0, y * 2.0)),
            SlabKind::Car if (along + 0.25).abs() < 1.25 => self.foot + self.height,
            SlabKind::Car => self.foot + 0.62 * self.height,
        })
    }
}

/// Something flat that only colours the ground: a drive, a terrace, a pool.
#[derive(Clone, Copy, Debug)]
pub struct Decal {
    pub frame: Frame,
    pub color: Rgb,
    /// Reflected intensity.
    pub intensity: u16,
}

/// A lattice tower of a power line; its axis runs along the arms, across the line.
#[derive(Clone, Copy, Debug)]
pub struct Pylon {
    pub frame: Frame,
    /// Absolute height of its foot.
    pub foot: f64,
}

/// Height of a pylon, m.
pub const PYLON_HEIGHT: f64 = 36.0;
/// Half width of a pylon's body at the foot, m.
pub const PYLON_HALF: f64 = 2.8;
/// Where the wires hang: offset across the line and height above the pylon's foot, m.
pub const WIRES: [[f64; 2]; 7] =
    [[-7.2, 23.0], [7.2, 23.0], [-5.2, 28.0], [5.2, 28.0], [-3.4, 32.4], [3.4, 32.4], [0.0, PYLON_HEIGHT]];

impl Pylon {
    /// Height of the topmost steel above (x, y), if there is any.
    pub fn steel(&self, x: f64, y: f64) -> Option<f64> {
        let [across, along] = self.frame.inside(x, y)?;
        let arm = WIRES[..6]
            .iter()
            .filter(|[reach, _]| across * reach > 0.0 && across.abs() <= reach.abs())
            .filter(|[reach, _]| along.abs() < 0.75 * (1.0 - across.abs() / (reach.abs() + 0.6)) + 0.1)
            .map(|[_, height]| self.foot + height + 0.3)
            .fold(f64::NEG_INFINITY, f64::max);
        // The body narrows upward, so a plumb line meets the face whose half width is this.
        let (near, far) = if across.abs() < along.abs() { (across, along) } else { (along, across) };
        let half = far.abs();
        let body = if half <= 0.35 {
            Some(PYLON_HEIGHT)
        } else if half <= PYLON_HALF {
            let height = PYLON_HEIGHT * (1.0 - (half - 0.35) / (PYLON_HALF - 0.35));
            // Legs at the corners, and braces that climb from corner to corner, 4 m a bay.
            let climb = (height / 4.0).rem_euclid(2.0);
            let brace = half * (1.0 - (climb - 1.0).abs() * 2.0);
            let steel = half - near.abs() < 0.22 || (near - brace).abs() < 0.2 || (near + brace).abs() < 0.2;
            steel.then_some(height)
        } else {
            None
        };
        let body = body.map_or(f64::NEG_INFINITY, |height| self.foot + height);
        let top = body.max(arm);
        top.is_finite().then_some(top)
    }
}

/// One of them.
#[derive(Clone, Copy, Debug)]
pub enum Object {
    Roof(Roof),
    Tree(Tree),
    Slab(Slab),
    Decal(Decal),
    Pylon(Pylon),
}

impl Object {
    /// West, south, east, north.
    pub fn bounds(&self) -> [f64; 4] {
        match self {
            Object::Roof(roof) => roof.frame.bounds(),
            Object::Slab(slab) => slab.frame.bounds(),
            Object::Decal(decal) => decal.frame.bounds(),
            Object::Pylon(pylon) => pylon.frame.bounds(),
            Object::Tree(tree) => {
                let reach = tree.radius * 1.12;
                let [x, y] = tree.centre;
                [x - reach, y - reach, x + reach, y + reach]
            }
        }
    }
}
