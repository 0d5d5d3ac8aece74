//! Places of returns in their pulses, their names and colours.

/// Place of a return in its pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReturnKind {
    /// Number or count is 0: the file does not say.
    Unknown,
    /// The only one.
    Single,
    /// The first of several.
    First,
    /// Neither first nor last.
    Intermediate,
    /// The last of several.
    Last,
}

impl ReturnKind {
    /// Reads a `returns` byte: number in the low nibble, count in the high one.
    pub fn of(returns: u8) -> ReturnKind {
        match (returns & 15, returns >> 4) {
            (0, _) | (_, 0) => ReturnKind::Unknown,
            (_, 1) => ReturnKind::Single,
            (1, _) => ReturnKind::First,
            (number, count) if number < count => ReturnKind::Intermediate,
            _ => ReturnKind::Last,
        }
    }

    /// For a legend.
    pub fn name(self) -> &'static str {
        match self {
            ReturnKind::Unknown => "unknown",
            ReturnKind::Single => "single",
            ReturnKind::First => "first of several",
            ReturnKind::Intermediate => "intermediate",
            ReturnKind::Last => "last of several",
        }
    }

    /// sRGB.
    pub fn color(self) -> [u8; 3] {
        match self {
            ReturnKind::Unknown => [150, 150, 150],
            ReturnKind::Single => [222, 208, 178],
            ReturnKind::First => [86, 164, 84],
            ReturnKind::Intermediate => [238, 154, 52],
            ReturnKind::Last => [78, 116, 190],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn returns_fall_into_four_kinds() {
        use ReturnKind::*;
        for (byte, kind) in [
            (0, Unknown),
            (0x01, Unknown),
            (0x11, Single),
            (0x21, First),
            (0x32, Intermediate),
            (0x33, Last),
            (0x25, Last),
        ] {
            assert_eq!(ReturnKind::of(byte), kind, "{byte:#x}");
        }
    }
}
