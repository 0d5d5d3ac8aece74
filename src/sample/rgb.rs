//! Whether a file's RGB fields hold colour, and how deep it is: once a file, never per point.

use super::open::Opened;
use crate::source::LidarFile;

/// A file with RGB and fewer sampled points than this is read a little further.
pub(super) const RGB_POINTS: usize = 256;

/// What a file's RGB fields hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RgbDepth {
    /// No colour: no such fields, or nothing but zeros in them.
    None,
    /// 8 bits in 16-bit fields.
    Eight,
    /// 16 bits, as the standard says.
    Sixteen,
}

impl RgbDepth {
    /// 8 bit a channel of a stored colour; black where there is none.
    #[inline]
    pub fn to_8_bit(self, rgb: [u16; 3]) -> [u8; 3] {
        match self {
            RgbDepth::None => [0; 3],
            RgbDepth::Eight => rgb.map(|value| value.min(255) as u8),
            RgbDepth::Sixteen => rgb.map(|value| (value >> 8) as u8),
        }
    }
}

/// Whether the point format has RGB.
pub fn has_rgb(file: &LidarFile) -> bool {
    matches!(file.header.format, 2 | 3 | 5 | 7 | 8 | 10)
}

/// Of the files that `seen` are points of. A file of which little was seen, and nothing beyond 255,
/// follows the other files of its format.
pub(super) fn decide(files: &[Opened], seen: &[Vec<[u16; 3]>]) -> Vec<RgbDepth> {
    let formats: Vec<Option<u8>> =
        files.iter().map(|opened| has_rgb(&opened.file).then_some(opened.file.header.format)).collect();
    let of_one = |index: usize| if formats[index].is_some() { depth(&seen[index]) } else { RgbDepth::None };
    let alone: Vec<RgbDepth> = (0..files.len()).map(of_one).collect();
    // One value throughout, if it is a small one, may be either.
    let varies = |index: usize| alone[index] == RgbDepth::None || constant(&seen[index]).is_none();
    let sure =
        |index: usize| alone[index] == RgbDepth::Sixteen || seen[index].len() >= RGB_POINTS && varies(index);
    let mut votes = [[0usize; 3]; 11];
    for (index, format) in formats.iter().enumerate().filter(|(index, _)| sure(*index)) {
        if let Some(format) = format {
            votes[usize::from(*format)][alone[index] as usize] += 1;
        }
    }
    let decide = |index: usize| {
        let Some(format) = formats[index].filter(|_| !sure(index)) else { return alone[index] };
        let [none, eight, sixteen] = votes[usize::from(format)];
        match none + eight + sixteen {
            0 => alone[index],
            _ if sixteen > eight && sixteen >= none => RgbDepth::Sixteen,
            _ if eight >= none => RgbDepth::Eight,
            _ => alone[index],
        }
    };
    (0..files.len()).map(decide).collect()
}

/// The one value of all colours that were seen, as stored, if there is one.
pub(super) fn constant(seen: &[[u16; 3]]) -> Option<[u16; 3]> {
    let first = *seen.first()?;
    seen.iter().all(|rgb| *rgb == first).then_some(first)
}

/// A few stray values beyond 255 do not make a file 16 bit, nor do black points make it 8 bit.
fn depth(seen: &[[u16; 3]]) -> RgbDepth {
    let bright = seen.iter().filter(|rgb| rgb.iter().any(|&value| value > 255)).count();
    if seen.iter().all(|rgb| *rgb == [0; 3]) {
        RgbDepth::None
    } else if bright * 200 > seen.len() {
        RgbDepth::Sixteen
    } else {
        RgbDepth::Eight
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_of_a_file() {
        assert_eq!(depth(&[]), RgbDepth::None);
        assert_eq!(depth(&[[0; 3]; 300]), RgbDepth::None);
        assert_eq!(depth(&[[90, 80, 70]; 300]), RgbDepth::Eight);
        assert_eq!(depth(&[[65_535; 3]; 300]), RgbDepth::Sixteen);
        assert_eq!((constant(&[[7; 3]; 9]), constant(&[])), (Some([7; 3]), None));
        assert_eq!(constant(&[[7; 3], [7, 7, 8]]), None);
        let ramp = |count: u16, step: u16| (0..count).map(|v| [v * step, 0, v]).collect::<Vec<_>>();
        assert_eq!(depth(&ramp(250, 1)), RgbDepth::Eight);
        assert_eq!(depth(&ramp(250, 256)), RgbDepth::Sixteen);
        // Mostly black, true 16 bit elsewhere; and 8 bit with one wild point.
        let mut mostly_black = vec![[0; 3]; 5000];
        mostly_black.extend(ramp(100, 500));
        assert_eq!(depth(&mostly_black), RgbDepth::Sixteen);
        let mut wild = ramp(250, 1);
        wild.push([65_535; 3]);
        assert_eq!(depth(&wild), RgbDepth::Eight);
        assert_eq!(RgbDepth::Sixteen.to_8_bit([0xffff, 0x80ff, 0]), [255, 128, 0]);
        assert_eq!(RgbDepth::Eight.to_8_bit([300, 128, 0]), [255, 128, 0]);
    }
}
