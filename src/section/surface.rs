//! What points stand for.

/// What the points of a column stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Surface {
    /// Each cell is solid from its highest point down
    Columns,
    /// What floats has air below it
    #[default]
    Stacks,
}

impl Surface {
    /// As it is typed.
    pub const fn name(self) -> &'static str {
        match self {
            Surface::Columns => "columns",
            Surface::Stacks => "stacks",
        }
    }
}
