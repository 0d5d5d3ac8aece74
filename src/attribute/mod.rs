//! Attributes of a point record, how they are packed, and the colours they are drawn in.
//!
//! Colours here (points' RGB, ramps, palettes) are sRGB-encoded; light is computed and EXR written in
//! linear values: [`srgb_to_linear`] after the lookup, [`linear_to_srgb`] before an 8-bit file.

mod channel;
mod class;
mod class_names;
mod counts;
mod flags;
mod mode;
mod oklab;
mod palette;
mod ramp;
mod range;
mod record;
mod returns;
mod srgb;
mod summary;
mod table;

pub use channel::{AboveScale, Channel, Steps, TimeScale};
pub use class::{ClassMask, always_floats, class_color, class_name, is_always_solid, tells_nothing};
pub use class_names::{class_names, class_numbers, classes_named};
pub use counts::KindCounts;
pub use flags::{Flags, Kind, Kinds};
pub use mode::ColorMode;
pub use ramp::Ramp;
pub use range::{ColorRange, RangeEnd, RangeError};
pub use record::{Attributes, Record};
pub(crate) use record::{bias, unbias};
pub use returns::ReturnKind;
pub use srgb::{linear_to_srgb, srgb_to_linear};
pub use summary::{AttributeSample, AttributeSummary, Scales, Spread};
pub use table::{AttributeError, ColorTable};
