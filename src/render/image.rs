//! The image in memory, and the files it is written to.

use crate::attribute::{Channel, linear_to_srgb};
use crate::coords::Grid;
use crate::output::{Output, SOFTWARE};
use crate::render::camera::Camera;
use crate::shared::passes::BITS_MISS;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Layer, LayerAttributes, Text,
    WritableImage,
};
use glam::DVec3;
use std::borrow::Cow;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Class of a pixel that hit nothing.
pub const MISS_CLASS: u32 = BITS_MISS;

/// What cannot be written, and why.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The system or the encoder refuses.
    #[error("{path}: cannot be written: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// More pixels than the format holds.
    #[error("{path}: cannot be written: such pictures have at most {most} pixels each way")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Most pixels each way.
        most: u32,
    },
    /// No pixels.
    #[error("{path}: cannot be written: the picture has no pixels")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// None of the formats that are written.
    #[error("{path}: pictures are written as .png, .jpg or .exr")]
    Extension {
        /// The file.
        path: PathBuf,
    },
}

/// Planes of `width` × `height` pixels, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// R, G, B linear and multiplied by A; A is the share of the pixel that is covered.
    pub color: Vec<[f32; 4]>,
    /// From eye to hit along the ray, CRS units; +inf on a miss.
    pub distance: Vec<f32>,
    /// U of the hit, CRS units; 0 on a miss.
    pub hit_height: Vec<f32>,
    /// ASPRS class; [`MISS_CLASS`] on a miss.
    pub class: Vec<u32>,
    /// Nodes that the traversal looked at for one ray a pixel, all pixels together.
    pub steps: u64,
    /// How the thing hit came to be (measured, bridged, …); 0 on a miss.
    pub origin: Vec<u32>,
    /// What of it was hit (`shared::passes::FACE_…`); 0 on a miss. Goes into no file.
    pub face: Vec<u8>,
    /// What the records that were hit hold in their channel, where colours are by that.
    pub values: Option<Values>,
}

/// What records hold in their channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// What codes mean.
    pub channel: Channel,
    /// One a pixel; 0 on a miss.
    pub codes: Vec<u16>,
}

impl Values {
    /// The values, one a pixel, with the name of a layer of a file; times count from the first that there is a code for. Not a
    /// number where a point has none.
    fn samples(&self) -> (&'static str, FlatSamples) {
        let numbers = || FlatSamples::U32(self.codes.iter().map(|&code| code.into()).collect());
        let values = |from: f64| {
            let value =
                |&code: &u16| self.channel.value(code).map_or(f32::NAN, |value| (value - from) as f32);
            FlatSamples::F32(self.codes.iter().map(value).collect())
        };
        match self.channel {
            Channel::Intensity => ("intensity", numbers()),
            Channel::SourceId => ("source_id", numbers()),
            Channel::ScanAngle => ("scan_angle", values(0.0)),
            Channel::GpsTime(scale) => ("gps_time", values(scale.from)),
            Channel::AboveGround(_) => ("height_above_ground", values(0.0)),
            Channel::Density(_) => ("density", values(0.0)),
            Channel::LineDifference(_) => ("line_difference", values(0.0)),
        }
    }
}

/// Key and value of a text that goes into the file, e.g. the camera as typed. Keys: 1 to 79 ASCII letters.
pub type Note<'a> = (&'a str, &'a str);

/// What is written into images from `camera`: where it is and what it looks at, and the step of the lattice that the
/// heights lie on, CRS units.
pub fn notes(camera: &Camera, grid: &Grid) -> [(&'static str, String); 3] {
    // To millimetres, or finer where heights are.
    let digits = (-grid.height_step.log10()).floor().max(3.0) as usize;
    let place = |v: DVec3| format!("{:.digits$},{:.digits$},{:.digits$}", v.x, v.y, v.z);
    [
        ("Eye", place(camera.eye())),
        ("Target", place(camera.target())),
        ("heightStep", grid.height_step.to_string()),
    ]
}

impl Image {
    /// An image in which no ray hits.
    pub fn new([width, height]: [u32; 2]) -> Image {
        let pixels = width as usize * height as usize;
        Image {
            width,
            height,
            color: vec![[0.0; 4]; pixels],
            distance: vec![f32::INFINITY; pixels],
            hit_height: vec![0.0; pixels],
            class: vec![MISS_CLASS; pixels],
            steps: 0,
            origin: vec![0; pixels],
            face: vec![0; pixels],
            values: None,
        }
    }

    /// Writes PNG, JPEG or EXR, by the extension of its name; `alpha` (of a PNG) as in [`Image::write_png`].
    pub fn write(&self, output: Output, alpha: bool, notes: &[Note]) -> Result<(), ImageError> {
        match Format::of(output.path())? {
            Format::Png => self.write_png(output, alpha, notes),
            Format::Jpeg => self.write_jpeg(output, notes),
            Format::Exr => self.write_exr(output, notes),
        }
    }

    /// Writes 8-bit sRGB, lossy; the notes stand in its Exif, as description.
    pub fn write_jpeg(&self, output: Output, notes: &[Note]) -> Result<(), ImageError> {
        self.check(output.path())?;
        let side = |pixels: u32| u16::try_from(pixels).map_err(|_| Format::Jpeg.too_large(output.path()));
        let (width, height) = (side(self.width)?, side(self.height)?);
        whole(output, |out| {
            let mut encoder = jpeg_encoder::Encoder::new(out, JPEG_QUALITY);
            // Edges between colours stay as sharp as those between light and dark.
            encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_1_1);
            encoder.add_exif_metadata(&exif_of(notes)?)?;
            let pixels: Vec<u8> =
                self.color.iter().flat_map(|&pixel| encode(pixel, false).into_iter().take(3)).collect();
            Ok(encoder.encode(&pixels, width, height, jpeg_encoder::ColorType::Rgb)?)
        })
    }

    /// Writes 8-bit sRGB; with `alpha` (not premultiplied) for images without background, else the
    /// colours as they are.
    pub fn write_png(&self, output: Output, alpha: bool, notes: &[Note]) -> Result<(), ImageError> {
        self.check(output.path())?;
        whole(output, |out| {
            let mut encoder = png::Encoder::new(out, self.width, self.height);
            encoder.set_color(if alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
            encoder.add_text_chunk("Software".to_owned(), SOFTWARE.to_owned())?;
            for &(key, value) in notes {
                if value.is_ascii() {
                    encoder.add_text_chunk(key.to_owned(), value.to_owned())?;
                } else {
                    encoder.add_itxt_chunk(key.to_owned(), value.to_owned())?;
                }
            }
            let mut writer = encoder.write_header()?;
            let mut stream = writer.stream_writer()?;
            let mut row = Vec::new();
            for pixels in self.color.chunks(self.width.max(1) as usize) {
                row.clear();
                for &pixel in pixels {
                    row.extend_from_slice(&encode(pixel, alpha)[..if alpha { 4 } else { 3 }]);
                }
                stream.write_all(&row)?;
            }
            stream.finish()?;
            Ok(writer.finish()?)
        })
    }

    /// Writes channels `R G B A distance height` (f32) and `class origin` (UINT), losslessly packed; where colours are by what
    /// records hold in their channel, that, too: `intensity` or `source_id` (UINT), `scan_angle` (f32, degrees), `gps_time`
    /// (f32, seconds since the attribute `gpsTimeFrom`), `height_above_ground` or `line_difference` (f32, CRS units) or `density`
    /// (f32, points in a square unit); of f32 NaN where there is no value.
    pub fn write_exr(&self, output: Output, notes: &[Note]) -> Result<(), ImageError> {
        self.check(output.path())?;
        let color = |k: usize| FlatSamples::F32(self.color.iter().map(|c| c[k]).collect());
        let channels = [
            ("R", color(0)),
            ("G", color(1)),
            ("B", color(2)),
            ("A", color(3)),
            ("distance", FlatSamples::F32(self.distance.clone())),
            ("height", FlatSamples::F32(self.hit_height.clone())),
            ("class", FlatSamples::U32(self.class.clone())),
            ("origin", FlatSamples::U32(self.origin.clone())),
        ];
        let values = self.values.as_ref().map(Values::samples);
        let channels = channels
            .into_iter()
            .chain(values)
            .map(|(name, samples)| AnyChannel::new(name, samples))
            .collect();
        // EXR texts are one byte a letter.
        let text = |s: &str| {
            let plain =
                if s.is_ascii() { Cow::Borrowed(s) } else { Cow::Owned(s.escape_default().to_string()) };
            Text::from(plain.as_ref())
        };
        let mut attributes =
            LayerAttributes { software_name: Some(text(SOFTWARE)), ..LayerAttributes::default() };
        if let Some(Values { channel: Channel::GpsTime(scale), .. }) = &self.values {
            let from = AttributeValue::Text(text(&scale.from.to_string()));
            attributes.other.insert(text("gpsTimeFrom"), from);
        }
        for (key, value) in notes {
            attributes.other.insert(text(key), AttributeValue::Text(text(value)));
        }
        let layer = Layer::new(
            (self.width as usize, self.height as usize),
            attributes,
            Encoding::SMALL_LOSSLESS,
            AnyChannels::sort(channels),
        );
        let image = exr::prelude::Image::from_layer(layer);
        whole(output, |out| Ok(image.write().to_buffered(out)?))
    }

    /// The EXR encoder panics on an image without pixels.
    fn check(&self, path: &Path) -> Result<(), ImageError> {
        let pixels = self.width as usize * self.height as usize;
        let planes = [
            self.color.len(),
            self.distance.len(),
            self.hit_height.len(),
            self.class.len(),
            self.origin.len(),
        ];
        assert!(planes.iter().all(|&n| n == pixels), "planes of {planes:?} pixels for {pixels}");
        if pixels > 0 { Ok(()) } else { Err(ImageError::Empty { path: path.to_owned() }) }
    }
}

/// What an image is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 8-bit sRGB.
    Png,
    /// The same, lossy.
    Jpeg,
    /// Colours and measured values in full.
    Exr,
}

impl Format {
    /// By the extension, in any case; so that a wrong one is refused before anything is drawn.
    pub fn of(path: &Path) -> Result<Format, ImageError> {
        let is = |e: &str| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
        if is("png") {
            Ok(Format::Png)
        } else if is("jpg") || is("jpeg") {
            Ok(Format::Jpeg)
        } else if is("exr") {
            Ok(Format::Exr)
        } else {
            Err(ImageError::Extension { path: path.to_owned() })
        }
    }

    /// Extension of the world file that stands beside a map.
    pub fn world_extension(self) -> &'static str {
        match self {
            Format::Png => "pgw",
            Format::Jpeg => "jgw",
            Format::Exr => "wld",
        }
    }

    /// Most pixels each way.
    pub fn most_pixels(self) -> u32 {
        match self {
            Format::Jpeg => u16::MAX.into(),
            Format::Png | Format::Exr => i32::MAX as u32,
        }
    }

    /// A picture of more pixels than the format holds.
    pub fn too_large(self, path: &Path) -> ImageError {
        ImageError::TooLarge { path: path.to_owned(), most: self.most_pixels() }
    }
}

/// Visually lossless, with smooth skies.
const JPEG_QUALITY: u8 = 92;

/// Who wrote it, and the notes, one a line, as Exif.
fn exif_of(notes: &[Note]) -> Result<Vec<u8>, exif::Error> {
    let field = |tag, text: String| exif::Field {
        tag,
        ifd_num: exif::In::PRIMARY,
        value: exif::Value::Ascii(vec![text.into_bytes()]),
    };
    let notes: Vec<_> = notes.iter().map(|(key, value)| format!("{key}: {value}")).collect();
    let fields = [
        field(exif::Tag::ImageDescription, notes.join("\n")),
        field(exif::Tag::Software, SOFTWARE.to_owned()),
    ];
    let mut writer = exif::experimental::Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut bytes = io::Cursor::new(Vec::new());
    writer.write(&mut bytes, true)?;
    Ok(bytes.into_inner())
}

/// Premultiplied linear → 8-bit sRGB; not premultiplied when `alpha` is kept.
fn encode([r, g, b, a]: [f32; 4], alpha: bool) -> [u8; 4] {
    let divisor = if alpha && a > 0.0 { a } else { 1.0 };
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let [r, g, b] = [r, g, b].map(|v| byte(linear_to_srgb((v / divisor).clamp(0.0, 1.0))));
    [r, g, b, byte(a)]
}

/// Errors of both encoders and of the system, as words.
struct Reason(String);

impl From<io::Error> for Reason {
    fn from(e: io::Error) -> Reason {
        Reason(e.to_string())
    }
}

impl From<png::EncodingError> for Reason {
    fn from(e: png::EncodingError) -> Reason {
        Reason(e.to_string())
    }
}

impl From<jpeg_encoder::EncodingError> for Reason {
    fn from(e: jpeg_encoder::EncodingError) -> Reason {
        Reason(e.to_string())
    }
}

impl From<exif::Error> for Reason {
    fn from(e: exif::Error) -> Reason {
        Reason(e.to_string())
    }
}

impl From<exr::error::Error> for Reason {
    fn from(e: exr::error::Error) -> Reason {
        Reason(e.to_string())
    }
}

fn whole(
    output: Output,
    write: impl FnOnce(&mut io::BufWriter<&std::fs::File>) -> Result<(), Reason>,
) -> Result<(), ImageError> {
    let path = output.path();
    output.write(write).map_err(|Reason(reason)| ImageError::Write { path: path.to_owned(), reason })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::srgb_to_linear;
    use std::fs::{self, File};
    use std::io::BufReader;

    /// 3 × 2 pixels, all planes different in all pixels, the last one a miss.
    fn picture() -> Image {
        let mut image = Image::new([3, 2]);
        for k in 0..5 {
            let v = k as f32;
            image.color[k] = [0.1 * v, 0.2, 1.0 - 0.1 * v, 1.0];
            image.distance[k] = 1000.125 + v;
            image.hit_height[k] = -3.5 * v;
            image.class[k] = 250 + k as u32;
            image.origin[k] = k as u32;
        }
        image
    }

    fn read_png(path: &Path) -> (Vec<u8>, png::Info<'static>) {
        let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        reader.finish().unwrap();
        (bytes, reader.info().clone())
    }

    #[test]
    fn exr_keeps_every_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("größe.exr");
        let image = picture();
        image
            .write(Output::fresh(&path), false, &[("camera", "--eye 1,2,3"), ("input", "größe.laz")])
            .unwrap();
        let read = exr::prelude::read_all_flat_layers_from_file(&path).unwrap();
        let [layer] = &read.layer_data[..] else { panic!("one layer expected") };
        assert_eq!((layer.size.0, layer.size.1), (3, 2));
        let names: Vec<String> = layer.channel_data.list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["A", "B", "G", "R", "class", "distance", "height", "origin"]);
        let samples = |name: &str| {
            let channel = layer.channel_data.list.iter().find(|c| c.name.eq_case_insensitive(name));
            &channel.unwrap().sample_data
        };
        let floats = |name: &str| match samples(name) {
            FlatSamples::F32(v) => v.clone(),
            other => panic!("{name} is {other:?}"),
        };
        let words = |name: &str| match samples(name) {
            FlatSamples::U32(v) => v.clone(),
            other => panic!("{name} is {other:?}"),
        };
        for (k, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
            assert_eq!(floats(name), image.color.iter().map(|c| c[k]).collect::<Vec<_>>());
        }
        assert_eq!((floats("distance"), floats("height")), (image.distance, image.hit_height));
        assert_eq!((words("class"), words("origin")), (image.class, image.origin));
        assert_eq!(layer.attributes.software_name, Some(Text::from(SOFTWARE)));
        let camera = layer.attributes.other.get(&Text::from("camera"));
        assert_eq!(camera, Some(&AttributeValue::Text(Text::from("--eye 1,2,3"))));
    }

    #[test]
    fn png_is_srgb_with_notes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.PNG");
        let image = picture();
        image
            .write(Output::fresh(&path), false, &[("Camera", "--eye 1,2,3"), ("Input", "größe.laz")])
            .unwrap();
        let (bytes, info) = read_png(&path);
        assert_eq!((info.width, info.height, info.color_type), (3, 2, png::ColorType::Rgb));
        assert!(info.srgb.is_some());
        for (k, pixel) in bytes.chunks(3).enumerate() {
            for (&byte, want) in pixel.iter().zip(image.color[k]) {
                assert!((srgb_to_linear(f32::from(byte) / 255.0) - want).abs() < 0.005, "pixel {k}");
            }
        }
        let latin = &info.uncompressed_latin1_text;
        assert!(latin.iter().any(|t| t.keyword == "Software" && t.text == SOFTWARE));
        assert!(latin.iter().any(|t| t.keyword == "Camera" && t.text == "--eye 1,2,3"));
        assert_eq!(info.utf8_text[0].get_text().unwrap(), "größe.laz");
    }

    #[test]
    fn jpeg_is_near_and_says_who_wrote_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.JPG");
        let mut image = Image::new([64, 32]);
        let v = srgb_to_linear(200.0 / 255.0);
        image.color.iter_mut().for_each(|pixel| *pixel = [v, 0.0, v, 1.0]);
        let notes = [("Eye", "1,2,3"), ("Input", "größe.laz"), ("Beside", "jgw=00ff")];
        image.write(Output::fresh(&path), false, &notes).unwrap();
        let bytes = fs::read(&path).unwrap();
        assert!(crate::output::is_ours(&bytes));
        let exif = exif::Reader::new().read_from_container(&mut io::Cursor::new(&bytes)).unwrap();
        let text = |tag| match &exif.get_field(tag, exif::In::PRIMARY).unwrap().value {
            exif::Value::Ascii(lines) => String::from_utf8(lines.concat()).unwrap(),
            other => panic!("{other:?}"),
        };
        assert_eq!(text(exif::Tag::Software), SOFTWARE);
        assert_eq!(text(exif::Tag::ImageDescription), "Eye: 1,2,3\nInput: größe.laz\nBeside: jgw=00ff");
        let mut decoder = jpeg_decoder::Decoder::new(io::Cursor::new(bytes));
        let pixels = decoder.decode().unwrap();
        let info = decoder.info().unwrap();
        assert_eq!((info.width, info.height), (64, 32));
        for pixel in pixels.chunks(3) {
            assert!(pixel.iter().zip([200u8, 0, 200]).all(|(a, b)| a.abs_diff(b) <= 3), "{pixel:?}");
        }
        // What no JPEG holds is refused, and nothing is left behind.
        let wide = Image::new([70_000, 1]);
        let said =
            wide.write(Output::fresh(&path.with_extension("jpeg")), false, &[]).unwrap_err().to_string();
        assert!(said.ends_with("at most 65535 pixels each way"), "{said}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn png_alpha_is_not_premultiplied() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut image = Image::new([2, 1]);
        let v = srgb_to_linear(200.0 / 255.0);
        image.color[0] = [v * 0.5, v * 0.5, 0.0, 0.5];
        image.write_png(Output::fresh(&path), true, &[]).unwrap();
        assert_eq!(read_png(&path).0, [200, 200, 0, 128, 0, 0, 0, 0]);
        assert_eq!(encode([f32::NAN, f32::INFINITY, -1.0, 2.0], false), [0, 255, 0, 255]);
    }

    #[test]
    fn failures_name_file_and_reason() {
        let folder = tempfile::tempdir().unwrap();
        let image = picture();
        let message = |path: &Path| image.write(Output::fresh(path), false, &[]).unwrap_err().to_string();
        let lost = folder.path().join("none").join("a.exr");
        assert_eq!(
            message(&lost),
            format!(
                "{}: cannot be written: {} does not exist",
                lost.display(),
                lost.parent().unwrap().display()
            )
        );
        assert!(message(Path::new("a.bmp")).contains("a.bmp: pictures are written as .png, .jpg or .exr"));
        assert!(message(Path::new("png")).contains(".png, .jpg or .exr"));
        // An encoder that refuses leaves nothing behind.
        let path = folder.path().join("a.png");
        assert!(Image::new([0, 5]).write(Output::fresh(&path), false, &[]).is_err());
        assert!(Image::new([0, 5]).write(Output::fresh(&path.with_extension("exr")), false, &[]).is_err());
        assert!(image.write(Output::fresh(&path), false, &[("", "no key")]).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
