//! What points stand for.

/// What the points of a column stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Surface {
    /// Each cell is solid from its highest point down
    Columns,
    /// What floats has air below it
    #[default]
    Stacks,
    /// As stacks, and what is solid is a smooth surface close up
    Smooth,
}

impl Surface {
    /// Whether what floats has air below it.
    pub const fn floats(self) -> bool {
        !matches!(self, Surface::Columns)
    }

    /// Most bytes that derived parts take of `bytes` that sections take on the device.
    pub const fn derived_of(self, bytes: u64) -> u64 {
        match self {
            Surface::Columns | Surface::Stacks => bytes / 2,
            Surface::Smooth => bytes / 3 * 2,
        }
    }

    /// As it is typed.
    pub const fn name(self) -> &'static str {
        match self {
            Surface::Columns => "columns",
            Surface::Stacks => "stacks",
            Surface::Smooth => "smooth",
        }
    }
}
