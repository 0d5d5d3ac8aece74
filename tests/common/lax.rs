//! Writes spatial indices as LAStools does, apart from what reads them.
#![allow(dead_code)] // each test file uses its part

use lasray::source::{Decoder, LidarFile};
use std::collections::BTreeMap;

/// An index.
#[derive(Clone)]
pub struct Lax {
    pub levels: u32,
    /// West and south of the whole, and its side: whole numbers, so that halves are exact.
    pub corner: [i32; 2],
    pub side: i32,
    /// First and last records, and points, by cell.
    pub cells: BTreeMap<u32, (Vec<(u64, u64)>, u64)>,
    /// Records have 64 bits.
    pub wide: bool,
    /// With "LASQ" and its version.
    pub tagged: bool,
}

/// All points of a file, E and N, chunk by chunk.
pub fn points(file: &LidarFile) -> Vec<[f64; 2]> {
    let (scale, offset) = (file.header.scale, file.header.offset);
    let mut points = Vec::new();
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        decoder
            .decode(file, chunk, 0..chunk.records, &mut |block| {
                points.extend(
                    block.x.iter().zip(&block.y).map(|(x, y)| {
                        [f64::from(*x) * scale.x + offset.x, f64::from(*y) * scale.y + offset.y]
                    }),
                );
            })
            .unwrap();
    }
    points
}

impl Lax {
    /// Of points in the order of their records; intervals run on over gaps of up to `gap` records.
    pub fn of(points: &[[f64; 2]], levels: u32, gap: u64) -> Lax {
        let low = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let corner = [low(0), low(1)].map(|v| (v / 64.0).floor() as i32 * 64);
        let wide = (high(0) - f64::from(corner[0])).max(high(1) - f64::from(corner[1]));
        let side = (wide.ceil() as u32 + 1).next_multiple_of(1 << levels.max(1)) as i32;
        let mut cells = BTreeMap::<u32, (Vec<(u64, u64)>, u64)>::new();
        for (record, point) in (0..).zip(points) {
            let along = |axis: usize| {
                let share = (point[axis] - f64::from(corner[axis])) / f64::from(side);
                ((share * f64::from(1u32 << levels)) as u32).min((1 << levels) - 1)
            };
            let (column, row) = (along(0), along(1));
            let place = (0..levels)
                .fold(0, |place, k| place | (column >> k & 1) << (2 * k) | (row >> k & 1) << (2 * k + 1));
            let before: u32 = (0..levels).map(|level| 4u32.pow(level)).sum();
            let (intervals, count) = cells.entry(before + place).or_default();
            *count += 1;
            match intervals.last_mut() {
                Some((_, last)) if record <= *last + 1 + gap => *last = record,
                _ => intervals.push((record, record)),
            }
        }
        Lax { levels, corner, side, cells, wide: false, tagged: true }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut raw = b"LASX\0\0\0\0LASS\0\0\0\0".to_vec();
        if self.tagged {
            raw.extend(b"LASQ\0\0\0\0");
        }
        raw.extend([self.levels, 0, 0].iter().flat_map(|v| v.to_le_bytes()));
        let [w, s] = self.corner.map(|v| v as f32);
        let [e, n] = self.corner.map(|v| (v + self.side) as f32);
        raw.extend([w, e, s, n].iter().flat_map(|v| v.to_le_bytes()));
        raw.extend(b"LASV");
        raw.extend(u32::from(self.wide).to_le_bytes());
        raw.extend((self.cells.len() as u32).to_le_bytes());
        let number = |raw: &mut Vec<u8>, value: u64| match self.wide {
            true => raw.extend(value.to_le_bytes()),
            false => raw.extend((value as u32).to_le_bytes()),
        };
        for (cell, (intervals, count)) in &self.cells {
            raw.extend(cell.to_le_bytes());
            raw.extend((intervals.len() as u32).to_le_bytes());
            number(&mut raw, *count);
            for (first, last) in intervals {
                number(&mut raw, *first);
                number(&mut raw, *last);
            }
        }
        raw
    }
}
