//! How points are read: which take part, and what the channel of a record holds of them. One for all files of a picture; what
//! was read in another way is made anew.

use super::Fields;
use super::selection::Selection;
use crate::attribute::Channel;

/// See the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Points that take part.
    pub selection: Selection,
    /// What their records hold in the place of the intensity.
    pub channel: Channel,
}

impl Reading {
    /// All points, as they are stored.
    pub fn is_plain(&self) -> bool {
        self.selection.is_all() && self.channel == Channel::Intensity
    }

    /// What is to be decoded for it.
    pub fn fields(&self) -> Fields {
        Fields {
            source_id: !self.selection.source_ids.is_all()
                || matches!(self.channel, Channel::SourceId | Channel::LineDifference(_)),
            scan_angle: self.channel == Channel::ScanAngle,
            gps_time: self.selection.needs_time() || matches!(self.channel, Channel::GpsTime(_)),
        }
    }

    /// What files of a point format lack that is asked for, in words; `None`: nothing.
    pub fn lacks(&self, format: u8) -> Option<String> {
        if !self.fields().gps_time || has_gps_time(format) {
            return None;
        }
        Some(match self.selection.needs_time() {
            true => format!("point format {format} has no GPS time: none of its points is selected by time"),
            false => format!("point format {format} has no GPS time: its points are grey"),
        })
    }
}

/// Whether points of a format have a GPS time (LAS 1.4 R15, tables 7 to 18).
fn has_gps_time(format: u8) -> bool {
    !matches!(format, 0 | 2)
}
