//! Small files that tests make.

use std::path::Path;

/// A file of points: E, N, U, class.
pub fn write(path: &Path, points: impl Iterator<Item = ([f64; 3], u8)>) {
    let mut header = las::Builder::from((1, 2));
    header.point_format = las::point::Format::new(0).unwrap();
    let scale = |offset: f64| las::Transform { scale: 0.01, offset };
    header.transforms = las::Vector { x: scale(500_000.0), y: scale(5_000_000.0), z: scale(0.0) };
    let mut writer = las::Writer::from_path(path, header.into_header().unwrap()).unwrap();
    for ([x, y, z], class) in points {
        let classification = las::point::Classification::new(class).unwrap();
        let (x, y) = (500_000.0 + x, 5_000_000.0 + y);
        writer.write_point(las::Point { x, y, z, classification, ..las::Point::default() }).unwrap();
    }
    writer.close().unwrap();
}

/// Every `step` units of a field, where there are points.
pub fn field(
    [width, height]: [f64; 2],
    step: f64,
    at: impl Fn(f64, f64) -> Option<(f64, u8)>,
) -> impl Iterator<Item = ([f64; 3], u8)> {
    let [columns, rows] = [width, height].map(|side| (side / step) as i32);
    let place = move |i: i32, j: i32| ((f64::from(i) + 0.5) * step, (f64::from(j) + 0.5) * step);
    let places = (0..rows).flat_map(move |j| (0..columns).map(move |i| place(i, j)));
    places.filter_map(move |(x, y)| at(x, y).map(|(z, class)| ([x, y, z], class)))
}
