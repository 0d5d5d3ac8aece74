//! The files beside an image that say where it lies on the map: which there are, and whose they are.

use super::camera::RayBasis;
use super::image::Format;
use crate::output::{self, Protected, Refusal, write_whole};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Side files are short: six numbers, a coordinate system.
const MOST_SIDE_BYTES: u64 = 1 << 20;

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

/// The files beside an image that say where it lies: a world file (`.pgw` for a PNG, `.jgw` for a JPEG, `.wld` for an EXR) and the CRS
/// as WKT (`.prj`).
///
/// Others have files of such names, too: `tile.prj` may belong to `tile.laz`. One that is there is replaced only
/// where the image that is there says that it was written with it: images carry digests of their side files
/// ([`SideFiles::note`]). All others are left alone, and where they do not say what ours would, that is said.
#[derive(Debug)]
pub struct SideFiles {
    image: PathBuf,
    /// What lies beside the image, or is to.
    files: Vec<SideFile>,
}

#[derive(Debug)]
struct SideFile {
    path: PathBuf,
    /// What is to be in it; `None`: it is to be absent.
    text: Option<String>,
    /// Digest of the one that was written with the image that is there.
    ours: Option<String>,
}

impl SideFile {
    fn extension(&self) -> &str {
        self.path.extension().and_then(|e| e.to_str()).unwrap_or_default()
    }

    /// As images carry it.
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
    /// Of the image that is about to be written to `image`: a map with `world`, or none. Looks at what lies there.
    pub fn new(image: &Path, world: Option<&WorldFile>, wkt: Option<&str>) -> SideFiles {
        let world_extension = Format::of(image).map_or("wld", Format::world_extension);
        let texts =
            [(world_extension, world.map(WorldFile::text)), ("prj", world.and(wkt).map(str::to_owned))];
        let head = output::head(image).ok().filter(|head| output::is_ours(head)).unwrap_or_default();
        let files = texts.map(|(extension, text)| {
            let mut file = SideFile { path: image.with_extension(extension), text, ours: None };
            let digest = file.there().map(|bytes| file.digest(&bytes));
            file.ours = digest.filter(|digest| output::holds(&head, digest.as_bytes()));
            file
        });
        SideFiles { image: image.to_owned(), files: files.into() }
    }

    /// What the image is to say of them; empty where there are none.
    pub fn note(&self) -> String {
        let digest = |file: &SideFile| file.text.as_ref().map(|text| file.digest(text.as_bytes()));
        self.files.iter().filter_map(digest).collect::<Vec<_>>().join(" ")
    }

    /// Writes them; gives what is to be said of those that are not as they should be.
    pub fn write(&self, protected: &Protected) -> Vec<String> {
        let mut said = Vec::new();
        for file in &self.files {
            let (path, image) = (file.path.display(), self.image.display());
            let is_world = file.extension() != "prj";
            let Some(text) = &file.text else {
                // A system without a place says nothing.
                if file.path.exists() && (is_world || self.files.iter().any(|file| file.text.is_some())) {
                    said.push(format!(
                        "{path}: does not belong to {image}, but programs that find it beside the picture will \
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
                said.push(format!("{path}: not written beside {image}: {error}{there}"));
            }
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Camera, Projection};
    use super::super::image::Image;
    use super::*;
    use crate::output::Output;
    use glam::DVec3;
    use std::fs;

    #[test]
    fn a_map_is_georeferenced() {
        let folder = tempfile::tempdir().unwrap();
        let center = DVec3::new(500_000.0, 6_000_000.0, 90.0);
        let map = Projection::Orthographic { units_per_pixel: 0.25 };
        let view = |angles, projection| {
            Camera::orbit(center, angles, 500.0, projection).unwrap().basis([400, 200]).unwrap()
        };
        let world = WorldFile::of(&view([0.0, 90.0], map)).unwrap();
        for (name, beside) in [
            ("top view.png", "top view.pgw"),
            ("top view.jpg", "top view.jgw"),
            ("top view.exr", "top view.wld"),
        ] {
            let side = SideFiles::new(&folder.path().join(name), Some(&world), Some("PROJCS[…]"));
            assert_eq!(side.write(&Protected::default()), [""; 0]);
            let path = folder.path().join(beside);
            // North-west pixel's centre: half a pixel inside the image's corner.
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
        let (nothing, image) = (Protected::default(), Image::new([3, 2]));
        let draw = |name: &str, side: f64, wkt: Option<&str>| {
            let path = at(name);
            let world = WorldFile { a: side, d: 0.0, b: 0.0, e: -side, c: 5.0, f: 6.0 };
            let files = SideFiles::new(&path, (side > 0.0).then_some(&world), wkt);
            let note = files.note();
            image.write(Output::over(&path, &nothing), false, &[("Beside", &note)]).unwrap();
            files.write(&nothing)
        };
        for (name, world) in [("map.png", "map.pgw"), ("bay.jpeg", "bay.jgw"), ("sea.exr", "sea.wld")] {
            let prj = format!("{}.prj", &name[..3]);
            fs::write(at(&prj), "of another program").unwrap();
            for side in [1.0, 2.0, 0.25] {
                // Ours is replaced, time and again; the other never.
                let said = draw(name, side, Some("PROJCS[…]"));
                assert!(
                    matches!(&said[..], [one] if one.contains(&prj) && one.contains("left as it is")),
                    "{said:?}"
                );
                assert!(read(world).starts_with(&format!("{side}\n")));
                assert_eq!(read(&prj), "of another program");
            }
            fs::remove_file(at(&prj)).unwrap();
            assert_eq!(draw(name, 1.0, Some("A")), [""; 0]);
            assert_eq!(draw(name, 1.0, Some("B")), [""; 0]);
            assert_eq!(read(&prj), "B");
            // A file that the user has changed is theirs from then on; one that says the same needs no word.
            fs::write(at(world), "7\n").unwrap();
            let said = draw(name, 3.0, Some("B"));
            assert!(matches!(&said[..], [one] if one.contains("in the wrong place")), "{said:?}");
            assert_eq!(read(world), "7\n");
            fs::write(at(world), "3\n0\n0\n-3\n5\n6\n").unwrap();
            assert_eq!(draw(name, 3.0, Some("B")), [""; 0]);
            // What was a map is none any more.
            let said = draw(name, 0.0, None);
            assert!(matches!(&said[..], [one] if one.contains("does not belong to")), "{said:?}");
            let said = draw(name, 3.0, None);
            assert!(matches!(&said[..], [one] if one.contains(&prj)), "{said:?}");
        }
        // An image of the same name that is not ours vouches for nothing, nor does a point cloud go.
        fs::write(at("a.png"), "\u{89}PNG").unwrap();
        fs::write(at("a.pgw"), "1\n").unwrap();
        fs::write(at("a.prj"), "LASF").unwrap();
        let said = draw("a.png", 3.0, Some("B"));
        assert_eq!((said.len(), read("a.pgw").as_str(), read("a.prj").as_str()), (2, "1\n", "LASF"));
        assert!(said[1].contains("point cloud"), "{said:?}");
    }
}
