//! What the records of LASzip's compatibility mode keep of a LAS 1.4 point where the older format has no room for it.

use super::FLAG_OVERLAP;

/// First byte, in a record, of what the older format has no room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct KeptApart {
    pub returns: usize,
    pub class: usize,
    pub flags: usize,
    /// Of a scan angle: steps of 0.006° beside the whole degrees.
    pub angle: usize,
}

impl KeptApart {
    /// First byte behind all of them.
    pub fn end(&self) -> usize {
        self.returns.max(self.class).max(self.flags).max(self.angle + 1) + 1
    }

    /// Scan angle in steps of 0.006°, of which `degrees` are kept as whole ones.
    #[inline]
    pub fn angle(&self, record: &[u8], degrees: i16) -> i16 {
        let rest = i16::from_le_bytes([record[self.angle], record[self.angle + 1]]);
        degrees.saturating_add(rest)
    }

    /// Gives a point back what was kept apart. `returns`: number in the low nibble, count in the high one.
    #[inline]
    pub fn restore(&self, record: &[u8], returns: &mut u8, class: &mut u8, flags: &mut u8) {
        let more = record[self.returns];
        *returns = ((*returns & 15) + (more >> 4)) & 15 | ((*returns >> 4) + (more & 15)) << 4;
        *class = class.wrapping_add(record[self.class]);
        if record[self.flags] & 1 != 0 {
            *flags |= FLAG_OVERLAP;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_apart_comes_back() {
        let at = KeptApart { returns: 0, class: 1, flags: 2, angle: 3 };
        let restore = |record: [u8; 3], mut returns: u8, mut class: u8, mut flags: u8| {
            at.restore(&record, &mut returns, &mut class, &mut flags);
            (returns, class, flags)
        };
        // Return 9 of 12 is kept as 4 of 7 with 5 and 5 to add.
        assert_eq!(restore([0x55, 0, 0b101], 0x74, 6, 4), (0xc9, 6, 4 | FLAG_OVERLAP));
        assert_eq!(restore([0, 200, 0b110], 0x11, 0, 0), (0x11, 200, 0));
        assert_eq!(at.end(), 5);
        // 12 whole degrees are 2000 steps.
        assert_eq!(at.angle(&[0, 0, 0, 0xfe, 0xff], 2000), 1998);
    }
}
