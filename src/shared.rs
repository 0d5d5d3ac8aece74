//! The constants that Rust and the shaders share. One table, `build/constants.rs`, is both these and an include for GLSL.

include!(concat!(env!("OUT_DIR"), "/shared.rs"));

#[cfg(test)]
mod tests {
    /// Lines around the drawing of a payload in the documentation.
    const BEGIN: &str = "<!-- payload: drawn from build/constants.rs -->\n```text\n";
    const END: &str = "```\n<!-- payload ends -->\n";

    #[test]
    fn the_documentation_draws_payloads_as_they_are() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/from-file-to-pixel.md");
        let text = std::fs::read_to_string(path).unwrap();
        let (_, rest) = text.split_once(BEGIN).expect("the drawing begins");
        let (drawn, _) = rest.split_once(END).expect("the drawing ends");
        let drawing = include_str!(concat!(env!("OUT_DIR"), "/payload.txt"));
        assert_eq!(drawn, drawing, "{path} draws payloads as they were; as they are:\n{drawing}");
    }
}
