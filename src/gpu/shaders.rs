//! The compiled shaders, one per `shaders/NAME.comp`: SPIR-V words.

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
