//! A scene's life: sections arrive while frames are drawn, are replaced, masked, taken out, and their slots
//! used again. Every frame is compared with a second scene that holds the same sections and was put together
//! at rest.

use crate::scene::{self, Data, MEASURED};
use glam::DVec3;
use lasray::attribute::{Attributes, ClassMask, ColorMode, ColorTable, Record};
use lasray::coords::{Bounds, Height, SectionKey};
use lasray::gpu::{Edge, Gpu, Order};
use lasray::render::camera::{Camera, Projection};
use lasray::render::frame::{Renderer, View};
use lasray::render::image::Image;
use lasray::resident::pool::Access;
use lasray::resident::scene::Scene;
use lasray::resident::visibility::Visibility;
use lasray::section::{Columns, Payload, column_at, device_bytes};
use std::collections::BTreeMap;

const SIZE: [u32; 2] = [160, 90];
/// Sections lie in rows of so many.
const ACROSS: i32 = 4;
/// How many there are from the start.
const SECTIONS: i32 = 8;
/// Slots that the pool has.
const SLOTS: u64 = 12;

/// Which sections there are, each by how many lattice steps its version is raised.
type Shown = BTreeMap<SectionKey, i32>;

/// One section of the town, to be put into many places at many heights.
pub struct Story {
    data: Data,
    camera: Camera,
}

/// A scene at rest.
struct Calm<'a> {
    story: &'a Story,
    scene: Scene,
    renderer: Renderer,
    shown: Shown,
}

/// The scene that is put to the test.
struct Busy<'a> {
    story: &'a Story,
    scene: Scene,
    renderer: Renderer,
    visibility: Visibility,
    calm: Calm<'a>,
    /// Validation takes a dispatch to use the whole of a storage buffer, hence of the pool: then nothing may
    /// be copied while the device is at work on other sections.
    at_rest: bool,
    /// What was seen that should not be.
    wrong: Vec<String>,
}

impl Story {
    pub fn new() -> Story {
        let folder = tempfile::tempdir().unwrap();
        // One section, full.
        let file = scene::town(folder.path(), "town.las", [0.0, 8.0], 128.0);
        let mut data = Data::load(&[file], Some(0.5));
        data.sections.sort_by_key(|(_, packed)| std::cmp::Reverse(packed.points));
        data.sections.truncate(1);
        let side = 128.0;
        let reach = DVec3::new(side * f64::from(ACROSS - 1), side * f64::from(SECTIONS / ACROSS), 40.0);
        data.bounds = Bounds { min: data.bounds.min, max: data.bounds.max + reach };
        data.colors = ColorTable { mode: ColorMode::Class, ..data.colors };
        let camera = Camera::frame(&data.bounds, [15.0, 50.0], Projection::default(), SIZE).unwrap();
        Story { data, camera }
    }

    fn key(&self, place: i32) -> SectionKey {
        let first = self.data.sections[0].0;
        SectionKey { i: first.i + place % ACROSS, j: first.j + place / ACROSS, ..first }
    }

    /// The section, raised.
    fn version(&self, raised: i32) -> Payload {
        let mut columns = Columns::default();
        self.data.sections[0].1.columns(|at, runs| {
            let [x, y] = column_at(at);
            for run in runs {
                let run = run.unpack().expect("a run");
                columns.add(x, y, Record::pack(Attributes { height: Height(run.height.0 + raised), ..run }));
            }
        });
        columns.pack()
    }

    /// Highest thing of the version that is not raised.
    fn top(&self, visibility: &Visibility) -> i32 {
        let shown = self.data.sections[0].1.highest_of.iter().filter(|(kind, _)| visibility.shows(*kind));
        shown.map(|(_, h)| h.0).max().expect("the section has such a class")
    }

    /// What the scene would name in a table now.
    fn shown(&self, scene: &Scene, visibility: &Visibility) -> Shown {
        let top = self.top(visibility);
        scene.entries().iter().map(|e| (e.key, e.top.0 - top)).collect()
    }

    fn draw(&self, scene: &mut Scene, renderer: &mut Renderer) -> Image {
        let view: View = self.data.exact(&self.camera, SIZE);
        renderer.draw(scene, &view).unwrap()
    }

    /// Tells it all; what was wrong.
    pub fn run(&self, gpu: &Gpu, access: Access, without: Option<Edge>) -> Vec<String> {
        let slot = device_bytes(&self.data.sections[0].1.layout);
        let order = |order: Order| match without {
            Some(edge) => order.without(edge),
            None => order,
        };
        let scene = self.data.empty(gpu, access, order, MEASURED(), SLOTS * slot);
        let calm = self.data.empty(gpu, access, |order| order, MEASURED(), 2 * SLOTS * slot);
        let mut busy = Busy {
            story: self,
            renderer: self.data.renderer(&scene),
            scene,
            visibility: MEASURED(),
            calm: Calm { story: self, renderer: self.data.renderer(&calm), scene: calm, shown: Shown::new() },
            at_rest: access == Access::StorageBuffer,
            wrong: Vec::new(),
        };
        busy.tell();
        busy.wrong
    }
}

impl Calm<'_> {
    /// The picture of `shown`.
    fn draw(&mut self, shown: &Shown, visibility: Visibility) -> Image {
        self.scene.set_visibility(visibility).unwrap();
        for (key, raised) in std::mem::take(&mut self.shown) {
            if shown.get(&key) != Some(&raised) {
                self.scene.evict(&[key]).unwrap();
            } else {
                self.shown.insert(key, raised);
            }
        }
        for (&key, &raised) in shown {
            if self.shown.insert(key, raised).is_none() {
                assert!(self.scene.upload(key, &self.story.version(raised)).unwrap());
            }
            self.scene.settle().unwrap();
        }
        self.story.draw(&mut self.scene, &mut self.renderer)
    }
}

impl Busy<'_> {
    fn upload(&mut self, place: i32, raised: i32) {
        if self.at_rest {
            // A picture comes after every build so far.
            self.story.draw(&mut self.scene, &mut self.renderer);
        }
        assert!(self.scene.upload(self.story.key(place), &self.story.version(raised)).unwrap(), "no room");
        if self.at_rest {
            self.scene.settle().unwrap();
        }
    }

    fn show(&mut self, classes: ClassMask) {
        self.visibility.classes = classes;
        self.scene.set_visibility(self.visibility).unwrap();
    }

    /// Draws what there is, and compares. Gives what there was.
    fn frame(&mut self, when: &str) -> Shown {
        let shown = self.story.shown(&self.scene, &self.visibility);
        let picture = self.story.draw(&mut self.scene, &mut self.renderer);
        let right = self.calm.draw(&shown, self.visibility);
        let differ = picture.distance.iter().zip(&right.distance).filter(|(a, b)| a != b).count();
        if picture != right {
            self.wrong.push(format!("{when}: {differ} pixels are wrong, {} sections", shown.len()));
        }
        shown
    }

    /// Lets everything arrive, and looks whether it is all there.
    fn rest(&mut self, when: &str, wanted: &Shown) {
        self.scene.settle().unwrap();
        let shown = self.frame(when);
        if shown != *wanted {
            self.wrong.push(format!("{when}: {shown:?} instead of {wanted:?}"));
        }
    }

    fn tell(&mut self) {
        let steps = self.story.data.grid.height_step.recip() as i32;
        let (all, ground) = (ClassMask::default(), ClassMask::only(&[2]));
        let key = |place| self.story.key(place);
        let mut wanted: Shown = (0..SECTIONS).map(|place| (key(place), place * steps)).collect();

        // Arrival: more than the ring holds at once, frames in between.
        for place in 0..SECTIONS {
            self.upload(place, place * steps);
            if place % 3 == 1 {
                self.scene.advance().unwrap();
                self.frame("while sections arrive");
            }
        }
        self.rest("all have arrived", &wanted);

        // Masks.
        self.show(ground);
        self.frame("under a mask");
        self.show(all);
        self.show(ground);
        self.show(all);
        self.frame("without the mask");

        // New versions, one of them overtaken by another on its way, a mask in between.
        for (place, raised) in [(0, 30), (6, 31), (7, 32), (6, 33)] {
            self.upload(place, raised * steps);
            wanted.insert(self.story.key(place), raised * steps);
        }
        self.frame("the old versions are there yet");
        self.show(ground);
        self.frame("the old versions under a mask");
        self.scene.advance().unwrap();
        self.show(all);
        self.frame("without the mask, the new ones on their way");
        self.rest("the new versions", &wanted);

        // More than the upload ring holds.
        for raised in 0..10 {
            self.upload(5, raised * steps);
        }
        wanted.insert(self.story.key(5), 9 * steps);
        self.rest("the last of many versions", &wanted);

        // Others in the same slots, while the device is at work on them.
        for (place, mask) in [(3, ground), (4, all), (5, ground), (0, all)] {
            self.show(mask);
            self.scene.evict(&[self.story.key(place)]).unwrap();
            wanted.remove(&self.story.key(place));
            self.upload(SECTIONS + place, (40 + place) * steps);
            wanted.insert(self.story.key(SECTIONS + place), (40 + place) * steps);
            if place == 4 {
                self.frame("while slots are used again");
            }
        }
        self.show(all);
        self.rest("slots were used again", &wanted);

        // All gone, and one back.
        wanted.keys().for_each(|&key| self.scene.evict(&[key]).unwrap());
        self.frame("nothing is left");
        self.upload(2, 0);
        self.rest("one is back", &Shown::from([(self.story.key(2), 0)]));
    }
}
