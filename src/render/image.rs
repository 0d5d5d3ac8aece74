//! The picture in memory, and the files it is written to.

use crate::attribute::linear_to_srgb;
use crate::coords::Grid;
use crate::output::{self, Output, Protected, Refusal, SOFTWARE, write_whole};
use crate::render::camera::{Camera, RayBasis};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Layer, LayerAttributes, Text,
    WritableImage,
};
use glam::DVec3;
use std::borrow::Cow;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Side files are short: six numbers, a coordinate system.
const MOST_SIDE_BYTES: u64 = 1 << 20;

/// Class of a pixel that hit nothing.
pub const MISS_CLASS: u32 = 256;

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
    /// No pixels.
    #[error("{path}: cannot be written: the picture has no pixels")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Neither PNG nor EXR.
    #[error("{path}: pictures are written as .png or .exr")]
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
}

/// Key and value of a text that goes into the file, e.g. the camera as typed. Keys: 1 to 79 ASCII letters.
pub type Note<'a> = (&'a str, &'a str);

/// What is written into pictures from `camera`: where it is and what it looks at, and the step of the lattice that the
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
    /// A picture in which no ray hits.
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
        }
    }

    /// Writes PNG or EXR, by the extension of its name; `alpha` (of a PNG) as in [`Image::write_png`].
    pub fn write(&self, output: Output, alpha: bool, notes: &[Note]) -> Result<(), ImageError> {
        match Format::of(output.path())? {
            Format::Png => self.write_png(output, alpha, notes),
            Format::Exr => self.write_exr(output, notes),
        }
    }

    /// Writes 8-bit sRGB; with `alpha` (not premultiplied) for pictures without background, else the
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

    /// Writes channels `R G B A distance height` (f32) and `class origin` (UINT), losslessly packed.
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
        let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
        // EXR texts are one byte a letter.
        let text = |s: &str| {
            let plain =
                if s.is_ascii() { Cow::Borrowed(s) } else { Cow::Owned(s.escape_default().to_string()) };
            Text::from(plain.as_ref())
        };
        let mut attributes =
            LayerAttributes { software_name: Some(text(SOFTWARE)), ..LayerAttributes::default() };
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

    /// The EXR encoder panics on a picture without pixels.
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

/// What a picture is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 8-bit sRGB.
    Png,
    /// Colours and measured values in full.
    Exr,
}

impl Format {
    /// By the extension, in any case; so that a wrong one is refused before anything is drawn.
    pub fn of(path: &Path) -> Result<Format, ImageError> {
        let is = |e: &str| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
        if is("png") {
            Ok(Format::Png)
        } else if is("exr") {
            Ok(Format::Exr)
        } else {
            Err(ImageError::Extension { path: path.to_owned() })
        }
    }
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

/// Pixel → world of a map: E = a · column + b · row + c, N = d · column + e · row + f, at pixel centres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldFile {
    /// E a pixel to the right.
    pub a: f64,
    /// N a pixel to the right.
    pub d: f64,
    /// E a pixel down.
    pub b: f64,
    /// N a pixel down.
    pub e: f64,
    /// E of the first pixel's centre.
    pub c: f64,
    /// N of the first pixel's centre.
    pub f: f64,
}

impl WorldFile {
    /// Of parallel rays straight down; `None` for any other view, which is no map.
    pub fn of(basis: &RayBasis) -> Option<WorldFile> {
        let plumb = basis.d0.x == 0.0 && basis.d0.y == 0.0 && basis.d0.z < 0.0;
        let parallel = basis.dx.length_squared() + basis.dy.length_squared() == 0.0;
        // Adding zero turns -0 into 0.
        (plumb && parallel).then_some(WorldFile {
            a: basis.ox.x + 0.0,
            d: basis.ox.y + 0.0,
            b: basis.oy.x + 0.0,
            e: basis.oy.y + 0.0,
            c: basis.origin(0.0, 0.0).x,
            f: basis.origin(0.0, 0.0).y,
        })
    }

    /// The same in another unit (E and N factors), e.g. back from metres to degrees.
    pub fn scaled(&self, [e, n]: [f64; 2]) -> WorldFile {
        WorldFile { a: self.a * e, d: self.d * n, b: self.b * e, e: self.e * n, c: self.c * e, f: self.f * n }
    }

    /// Six lines.
    fn text(&self) -> String {
        let WorldFile { a, d, b, e, c, f } = self;
        format!("{a}\n{d}\n{b}\n{e}\n{c}\n{f}\n")
    }
}

/// The files beside a picture that say where it lies: a world file (`.pgw` for a PNG, `.wld` for others) and the CRS
/// as WKT (`.prj`).
///
/// Others have files of such names, too: `tile.prj` may belong to `tile.laz`. One that is there is replaced only
/// where the picture that is there says that it was written with it: pictures carry digests of their side files
/// ([`SideFiles::note`]). All others are left alone, and where they do not say what ours would, that is said.
#[derive(Debug)]
pub struct SideFiles {
    picture: PathBuf,
    /// What lies beside the picture, or is to.
    files: Vec<SideFile>,
}

#[derive(Debug)]
struct SideFile {
    path: PathBuf,
    /// What is to be in it; `None`: it is to be absent.
    text: Option<String>,
    /// Digest of the one that was written with the picture that is there.
    ours: Option<String>,
}

impl SideFile {
    fn extension(&self) -> &str {
        self.path.extension().and_then(|e| e.to_str()).unwrap_or_default()
    }

    /// As pictures carry it.
    fn digest(&self, bytes: &[u8]) -> String {
        format!("{}={:016x}", self.extension(), xxhash_rust::xxh3::xxh3_64(bytes))
    }

    /// The bytes that are there; none of what is too long for a side file, or no file.
    fn there(&self) -> Option<Vec<u8>> {
        let is_small = std::fs::metadata(&self.path).is_ok_and(|m| m.is_file() && m.len() <= MOST_SIDE_BYTES);
        is_small.then(|| std::fs::read(&self.path).ok()).flatten()
    }

    /// Whether what is there now may be replaced.
    fn may_go(&self, protected: &Protected) -> Result<(), Refusal> {
        let is_ours = || self.ours.is_some() && self.ours == self.there().map(|bytes| self.digest(&bytes));
        match protected.check(&self.path) {
            // The digest says more than the folder it lies in.
            Ok(()) | Err(Refusal::Foreign(_)) if self.path.symlink_metadata().is_err() || is_ours() => Ok(()),
            Ok(()) | Err(Refusal::Foreign(_)) => Err(Refusal::NotOfPicture),
            refused => refused,
        }
    }
}

impl SideFiles {
    /// Of the picture that is about to be written to `picture`: a map with `world`, or none. Looks at what lies there.
    pub fn new(picture: &Path, world: Option<&WorldFile>, wkt: Option<&str>) -> SideFiles {
        let is_png = Format::of(picture).is_ok_and(|f| f == Format::Png);
        let texts = [
            (if is_png { "pgw" } else { "wld" }, world.map(WorldFile::text)),
            ("prj", world.and(wkt).map(str::to_owned)),
        ];
        let head = output::head(picture).ok().filter(|head| output::is_ours(head)).unwrap_or_default();
        let files = texts.map(|(extension, text)| {
            let mut file = SideFile { path: picture.with_extension(extension), text, ours: None };
            let digest = file.there().map(|bytes| file.digest(&bytes));
            file.ours = digest.filter(|digest| output::holds(&head, digest.as_bytes()));
            file
        });
        SideFiles { picture: picture.to_owned(), files: files.into() }
    }

    /// What the picture is to say of them; empty where there are none.
    pub fn note(&self) -> String {
        let digest = |file: &SideFile| file.text.as_ref().map(|text| file.digest(text.as_bytes()));
        self.files.iter().filter_map(digest).collect::<Vec<_>>().join(" ")
    }

    /// Writes them; gives what is to be said of those that are not as they should be.
    pub fn write(&self, protected: &Protected) -> Vec<String> {
        let mut said = Vec::new();
        for file in &self.files {
            let (path, picture) = (file.path.display(), self.picture.display());
            let is_world = file.extension() != "prj";
            let Some(text) = &file.text else {
                // A system without a place says nothing.
                if file.path.exists() && (is_world || self.files.iter().any(|file| file.text.is_some())) {
                    said.push(format!(
                        "{path}: does not belong to {picture}, but programs that find it beside the picture will \
                         take it for its place on the map: move one of them away"
                    ));
                }
                continue;
            };
            if file.there().is_some_and(|there| there == text.as_bytes()) {
                continue;
            }
            let written: io::Result<()> =
                write_whole(&file.path, |_| file.may_go(protected), |out| out.write_all(text.as_bytes()));
            if let Err(error) = written {
                let there = match (file.path.exists(), is_world) {
                    (false, _) => "",
                    (true, true) => {
                        "; programs that place the picture by it will put it in the wrong place: move it away, or \
                         give the picture another name"
                    }
                    (true, false) => {
                        "; check that it names the picture's coordinate system, or give the picture another name"
                    }
                };
                said.push(format!("{path}: not written beside {picture}: {error}{there}"));
            }
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::srgb_to_linear;
    use crate::render::camera::Projection;
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
    fn a_map_is_georeferenced() {
        let folder = tempfile::tempdir().unwrap();
        let center = DVec3::new(500_000.0, 6_000_000.0, 90.0);
        let map = Projection::Orthographic { units_per_pixel: 0.25 };
        let view = |angles, projection| {
            Camera::orbit(center, angles, 500.0, projection).unwrap().basis([400, 200]).unwrap()
        };
        let world = WorldFile::of(&view([0.0, 90.0], map)).unwrap();
        for (name, beside) in [("top view.png", "top view.pgw"), ("top view.exr", "top view.wld")] {
            let side = SideFiles::new(&folder.path().join(name), Some(&world), Some("PROJCS[…]"));
            assert_eq!(side.write(&Protected::default()), [""; 0]);
            let path = folder.path().join(beside);
            // North-west pixel's centre: half a pixel inside the picture's corner.
            assert_eq!(fs::read_to_string(path).unwrap(), "0.25\n0\n0\n-0.25\n499950.125\n6000024.875\n");
        }
        assert_eq!(WorldFile::of(&view([0.0, 89.0], map)), None);
        assert_eq!(WorldFile::of(&view([0.0, -90.0], map)), None);
        assert_eq!(WorldFile::of(&view([0.0, 90.0], Projection::default())), None);
        let half = world.scaled([0.5, 2.0]);
        assert_eq!((half.a, half.e, half.c, half.f), (0.125, -0.5, 249_975.062_5, 12_000_049.75));
        assert_eq!(fs::read_to_string(folder.path().join("top view.prj")).unwrap(), "PROJCS[…]");
    }

    #[test]
    fn side_files_of_others_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let read = |name: &str| fs::read_to_string(at(name)).unwrap();
        let (nothing, image) = (Protected::default(), picture());
        let draw = |name: &str, side: f64, wkt: Option<&str>| {
            let path = at(name);
            let world = WorldFile { a: side, d: 0.0, b: 0.0, e: -side, c: 5.0, f: 6.0 };
            let files = SideFiles::new(&path, (side > 0.0).then_some(&world), wkt);
            let note = files.note();
            image.write(Output::over(&path, &nothing), false, &[("Beside", &note)]).unwrap();
            files.write(&nothing)
        };
        for (picture, world) in [("map.png", "map.pgw"), ("sea.exr", "sea.wld")] {
            let prj = format!("{}.prj", &picture[..3]);
            fs::write(at(&prj), "of another program").unwrap();
            for side in [1.0, 2.0, 0.25] {
                // Ours is replaced, time and again; the other never.
                let said = draw(picture, side, Some("PROJCS[…]"));
                assert!(
                    matches!(&said[..], [one] if one.contains(&prj) && one.contains("left as it is")),
                    "{said:?}"
                );
                assert!(read(world).starts_with(&format!("{side}\n")));
                assert_eq!(read(&prj), "of another program");
            }
            fs::remove_file(at(&prj)).unwrap();
            assert_eq!(draw(picture, 1.0, Some("A")), [""; 0]);
            assert_eq!(draw(picture, 1.0, Some("B")), [""; 0]);
            assert_eq!(read(&prj), "B");
            // A file that the user has changed is theirs from then on; one that says the same needs no word.
            fs::write(at(world), "7\n").unwrap();
            let said = draw(picture, 3.0, Some("B"));
            assert!(matches!(&said[..], [one] if one.contains("in the wrong place")), "{said:?}");
            assert_eq!(read(world), "7\n");
            fs::write(at(world), "3\n0\n0\n-3\n5\n6\n").unwrap();
            assert_eq!(draw(picture, 3.0, Some("B")), [""; 0]);
            // What was a map is none any more.
            let said = draw(picture, 0.0, None);
            assert!(matches!(&said[..], [one] if one.contains("does not belong to")), "{said:?}");
            let said = draw(picture, 3.0, None);
            assert!(matches!(&said[..], [one] if one.contains(&prj)), "{said:?}");
        }
        // A picture of the same name that is not ours vouches for nothing, nor does a point cloud go.
        fs::write(at("a.png"), "\u{89}PNG").unwrap();
        fs::write(at("a.pgw"), "1\n").unwrap();
        fs::write(at("a.prj"), "LASF").unwrap();
        let said = draw("a.png", 3.0, Some("B"));
        assert_eq!((said.len(), read("a.pgw").as_str(), read("a.prj").as_str()), (2, "1\n", "LASF"));
        assert!(said[1].contains("point cloud"), "{said:?}");
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
        assert!(message(Path::new("a.jpg")).contains("a.jpg: pictures are written as .png or .exr"));
        assert!(message(Path::new("png")).contains(".png or .exr"));
        // An encoder that refuses leaves nothing behind.
        let path = folder.path().join("a.png");
        assert!(Image::new([0, 5]).write(Output::fresh(&path), false, &[]).is_err());
        assert!(Image::new([0, 5]).write(Output::fresh(&path.with_extension("exr")), false, &[]).is_err());
        assert!(image.write(Output::fresh(&path), false, &[("", "no key")]).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
