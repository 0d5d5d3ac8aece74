//! What lies under the cursor, or where the user has clicked, in words and numbers.

use super::data::DataAbout;
use crate::render::screen::PickedPoint;
use crate::source::crs::CrsKind;
use crate::text::tidy;
use glam::DVec3;

/// E and N of the place and U of the record, in coordinates of the world's system.
fn place(point: &PickedPoint, about: &DataAbout) -> DVec3 {
    about.base.unplace(DVec3 { z: point.height, ..point.shown })
}

fn is_degrees(about: &DataAbout) -> bool {
    about.crs.as_ref().is_some_and(|crs| crs.kind == CrsKind::Geographic)
}

/// For people: E and N of the place, U of the record.
pub fn coordinates(point: &PickedPoint, about: &DataAbout) -> String {
    let at = place(point, about);
    let unit = about.unit.as_ref().map_or("", |u| u.symbol());
    let digits = if is_degrees(about) { 7 } else { 2 };
    format!("E {:.digits$}   N {:.digits$}   U {:.2} {unit}", at.x, at.y, at.z)
}

/// For other programs: `E, N, U`, in millimetres or finer.
pub fn copied(point: &PickedPoint, about: &DataAbout) -> String {
    let at = place(point, about);
    let digits = if is_degrees(about) { 8 } else { 3 };
    format!("{:.digits$}, {:.digits$}, {:.3}", at.x, at.y, at.z)
}

/// What is to be known beside that: the place is on the side of the record's column, so far below it; there is no record,
/// but a hole that is bridged; the record is the highest of a cell larger than the finest, which may stand in for them.
/// `None`: nothing is.
pub fn caution(point: &PickedPoint, unit: Option<&str>) -> Option<String> {
    let length = |length: f64| {
        let digits = if length < 10.0 { 100.0 } else { 10.0 };
        let number = tidy((length * digits).round() / digits);
        unit.map_or(number.clone(), |unit| format!("{number} {unit}"))
    };
    let side = point.below.map(|below| match below < 0.005 {
        true => "side".to_owned(),
        false => format!("side, {} below", length(below)),
    });
    let bridged = point.is_bridged.then(|| "bridged hole".to_owned());
    let coarse = point.coarse_cell.map(|cell| match point.stands_in {
        true => format!("stand-in, cell {}", length(cell)),
        false => format!("cell {}", length(cell)),
    });
    let all: Vec<_> = side.into_iter().chain(bridged).chain(coarse).collect();
    (!all.is_empty()).then(|| all.join("; "))
}

/// For the log of events.
pub fn logged(point: Option<&PickedPoint>) -> String {
    let Some(point) = point else { return "nothing".to_owned() };
    let at = point.shown;
    let mut line = format!("{:.3} {:.3} {:.3} class {}", at.x, at.y, point.height, point.class);
    line.extend(point.value.map(|(channel, code)| format!(" {}", channel.words(code, None))));
    line.extend(point.below.map(|below| format!(" side {below:.3}")));
    line.push_str(if point.is_bridged { " bridged" } else { "" });
    line.extend(point.coarse_cell.map(|cell| format!(" cell {cell}")));
    line.push_str(if point.stands_in { " stand-in" } else { "" });
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Channel;

    #[test]
    fn what_is_no_measured_top_is_said_to_be_none() {
        let top = PickedPoint {
            shown: DVec3::new(1.0, 2.0, 3.0),
            height: 44.18,
            class: 14,
            value: None,
            below: None,
            is_bridged: false,
            coarse_cell: None,
            stands_in: false,
        };
        let said = |point: PickedPoint| caution(&point, Some("m"));
        assert_eq!(said(top), None);
        let side = PickedPoint { below: Some(10.2345), ..top };
        assert_eq!(said(side).as_deref(), Some("side, 10.2 m below"));
        assert_eq!(caution(&side, None).as_deref(), Some("side, 10.2 below"));
        assert_eq!(said(PickedPoint { below: Some(0.333), ..top }).as_deref(), Some("side, 0.33 m below"));
        assert_eq!(said(PickedPoint { below: Some(0.004), ..top }).as_deref(), Some("side"));
        let bridged = PickedPoint { is_bridged: true, ..side };
        assert_eq!(said(bridged).as_deref(), Some("side, 10.2 m below; bridged hole"));
        let coarse = PickedPoint { coarse_cell: Some(4.0), ..top };
        assert_eq!(said(coarse).as_deref(), Some("cell 4 m"));
        let stand_in = PickedPoint { stands_in: true, ..coarse };
        assert_eq!(said(stand_in).as_deref(), Some("stand-in, cell 4 m"));
        assert_eq!(logged(Some(&top)), "1.000 2.000 44.180 class 14");
        let line = PickedPoint { value: Some((Channel::SourceId, 7)), ..top };
        assert_eq!(logged(Some(&line)), "1.000 2.000 44.180 class 14 source id 7");
        assert_eq!(
            logged(Some(&PickedPoint { is_bridged: true, below: Some(1.5), ..stand_in })),
            "1.000 2.000 44.180 class 14 side 1.500 bridged cell 4 stand-in"
        );
    }
}
