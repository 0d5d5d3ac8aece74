//! Vulkan as the tests need it: a named driver, the newer validation layer, two queue families.
//!
//! Variables choose another reference driver than lavapipe:
//!
//! - `LASRAY_TEST_ICD`: the manifest of a driver (`/usr/share/vulkan/icd.d/NAME.json`), to run the suite on a GPU.
//! - `LASRAY_TEST_QUEUES`: `eager`, `late1` or `late0`: the reference driver is seen through the two-queues layer in that
//!   order, as if it were a GPU with a transfer family.
//! - `LASRAY_VALIDATION_LAYER_DIR`: folder with the manifest of a newer validation layer.
//!
//! The loader reads its environment when it is opened, so each setup is a child process: the test binary
//! runs itself for one test, with that environment.
#![allow(dead_code)] // each test file uses its part

pub mod made;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

const CHILD: &str = "LASRAY_TEST_SETUP";
const ICD: &str = "LASRAY_TEST_ICD";
const QUEUES: &str = "LASRAY_TEST_QUEUES";
const DRIVERS: [&str; 4] = [
    "/usr/share/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/opt/homebrew/share/vulkan/icd.d",
];
const LAYERS: [&str; 3] = [
    "/usr/share/vulkan/explicit_layer.d",
    "/usr/local/share/vulkan/explicit_layer.d",
    "/etc/vulkan/explicit_layer.d",
];
/// Debian's browser package carries SwiftShader and a newer validation layer than Debian's own.
const CHROMIUM: &str = "/usr/lib/chromium";
/// Earlier ones do not see a missing wait between two submits.
const OLDEST_LAYER_WITH_QUEUE_SYNC: [u32; 3] = [1, 3, 290];

/// Which driver a test runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Driver {
    /// The reference: what `LASRAY_TEST_ICD` names, else Mesa's, else what the system picks.
    Lavapipe,
    /// The second one.
    SwiftShader,
    /// A machine without any.
    None,
}

/// One environment to run a test in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    pub driver: Driver,
    /// Order of the layer that shows two queue families; `None`: the driver as it is, which may have as many.
    pub two_queues: Option<&'static str>,
    /// Files that a disk fails to read: a part of their paths, and the first byte of those that fail.
    pub failing: Option<(&'static str, u64)>,
}

/// The reference driver as it is.
pub const LAVAPIPE: Setup = Setup { driver: Driver::Lavapipe, two_queues: None, failing: None };
/// The second driver as it is.
pub const SWIFTSHADER: Setup = Setup { driver: Driver::SwiftShader, two_queues: None, failing: None };
/// A machine without a driver.
pub const NO_DRIVER: Setup = Setup { driver: Driver::None, two_queues: None, failing: None };
/// Two queue families on the reference driver, in the three orders.
pub const ORDERS: [Setup; 3] = [with_order("eager"), with_order("late1"), with_order("late0")];

const fn with_order(order: &'static str) -> Setup {
    Setup { driver: Driver::Lavapipe, two_queues: Some(order), failing: None }
}

impl Setup {
    /// Opens the device under validation.
    pub fn gpu(self) -> lasray::gpu::Gpu {
        self.gpu_with(None)
    }

    /// The same, compiled programs being kept in a folder.
    pub fn gpu_with(self, cache: Option<PathBuf>) -> lasray::gpu::Gpu {
        self.try_gpu(cache).unwrap_or_else(|e| panic!("{self:?}: {e}"))
    }

    /// Order of the two-queues layer, if it is there.
    pub fn queue_order(self) -> Option<String> {
        let chosen = || env::var(QUEUES).ok().filter(|_| self.driver == Driver::Lavapipe);
        self.two_queues.map(str::to_owned).or_else(chosen)
    }

    fn try_gpu(self, cache: Option<PathBuf>) -> lasray::gpu::Result<lasray::gpu::Gpu> {
        let layers = self.queue_order().map(|_| "VK_LAYER_TEST_two_queues".to_owned());
        lasray::gpu::Gpu::new(&lasray::gpu::GpuOptions {
            device: None,
            validate: true,
            layers: layers.into_iter().collect(),
            cache,
            ..Default::default()
        })
    }
}

/// A folder in the place of the user's cache: tests leave that alone.
pub fn cache() -> (&'static str, &'static str) {
    ("LASRAY_CACHE", concat!(env!("CARGO_TARGET_TMPDIR"), "/cache"))
}

/// Runs `body` in `setup`, for the test called `test` (its path as `--exact` takes it). A test may call
/// it several times, with other setups.
pub fn run(test: &str, setup: Setup, body: impl FnOnce(Setup)) {
    let label = format!("{setup:?}");
    match env::var(CHILD) {
        Ok(here) if here == label => return body(setup),
        Ok(_) => return, // the child of another setup
        Err(_) => {}
    }
    let Some(environment) = environment(setup) else {
        println!("{test}: SwiftShader is not installed (Debian's package `chromium` has it): skipped");
        return;
    };
    let mut child = Command::new(env::current_exe().unwrap());
    child.args(["--exact", test, "--nocapture", "--test-threads=1"]).env(CHILD, label).envs(environment);
    let output = child.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{test} in {setup:?}: {}\n{text}", output.status);
    assert!(text.contains("1 passed"), "there is no test {test}:\n{text}");
    let said =
        text.lines().filter(|l| !l.is_empty() && !l.starts_with("running ") && !l.starts_with("test "));
    said.for_each(|line| println!("{test}: {line}"));
}

/// Whether the validation layer sees a missing wait between two submits; says so when it does not.
pub fn layer_sees_queues(test: &str) -> bool {
    let sees = newer_layer().is_some();
    if !sees && env::var(CHILD).is_err() {
        println!(
            "{test}: the validation layer is older than {}.{}.{} (Debian's package `chromium` has a newer one): skipped",
            OLDEST_LAYER_WITH_QUEUE_SYNC[0], OLDEST_LAYER_WITH_QUEUE_SYNC[1], OLDEST_LAYER_WITH_QUEUE_SYNC[2]
        );
    }
    sees
}

/// The environment of a setup; `None` when its driver is not installed.
fn environment(setup: Setup) -> Option<Vec<(&'static str, String)>> {
    // Without it synchronization validation leaves out what shaders do with storage buffers.
    let mut set = vec![("VK_LAYER_SYNCVAL_SHADER_ACCESSES_HEURISTIC", "1".to_owned())];
    let driver = match setup.driver {
        Driver::Lavapipe => env::var_os(ICD).map(PathBuf::from).or_else(|| find(&DRIVERS, "lvp_icd")),
        Driver::None => Some(PathBuf::from("/nowhere.json")),
        Driver::SwiftShader => {
            Some(Path::new(CHROMIUM).join("vk_swiftshader_icd.json")).filter(|p| p.is_file())
        }
    };
    match driver {
        Some(manifest) => {
            let manifest = manifest.to_string_lossy().into_owned();
            set.push(("VK_ICD_FILENAMES", manifest.clone())); // what loaders before 1.3.207 know
            set.push(("VK_DRIVER_FILES", manifest));
        }
        None if setup.driver == Driver::SwiftShader => return None,
        None => {} // not Debian: the system's choice
    }
    let mut layers = Vec::new();
    // Without one that is newer, the loader's own search finds what there is.
    layers.extend(
        newer_layer().or_else(|| Some(find(&LAYERS, "VkLayer_khronos_validation")?.parent()?.to_owned())),
    );
    let order = setup.queue_order();
    let in_order = order.is_some();
    if let Some(order) = order {
        set.push(("TWO_QUEUES", order));
        layers.push(two_queues_manifest());
    }
    if let Some((path, from)) = setup.failing {
        set.push(("LD_PRELOAD", library("failing_disk").to_string_lossy().into_owned()));
        set.push(("FAILING_DISK", path.to_owned()));
        set.push(("FAILING_DISK_FROM", from.to_string()));
    }
    let variable = if layers.len() == usize::from(in_order) { "VK_ADD_LAYER_PATH" } else { "VK_LAYER_PATH" };
    set.push((variable, env::join_paths(layers).unwrap().into_string().unwrap()));
    Some(set)
}

/// The first file in `folders` whose name starts with `name`.
fn find(folders: &[&str], name: &str) -> Option<PathBuf> {
    folders
        .iter()
        .filter_map(|folder| fs::read_dir(folder).ok())
        .flat_map(|entries| entries.flatten().map(|e| e.path()))
        .find(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with(name)))
}

/// The folder with the manifest of a validation layer that is new enough: LASRAY_VALIDATION_LAYER_DIR, the
/// browser's, or the system's.
fn newer_layer() -> Option<PathBuf> {
    if let Some(folder) = env::var_os("LASRAY_VALIDATION_LAYER_DIR") {
        return Some(folder.into());
    }
    let library = Path::new(CHROMIUM).join("libVkLayer_khronos_validation.so");
    if library.is_file() {
        let extension =
            |name: &str, version: &str| serde_json::json!({ "name": name, "spec_version": version });
        let extensions = [extension("VK_EXT_debug_utils", "1"), extension("VK_EXT_validation_features", "2")];
        return Some(manifest("VK_LAYER_KHRONOS_validation", &library, &extensions));
    }
    let system = find(&LAYERS, "VkLayer_khronos_validation")?;
    let text = fs::read_to_string(&system).ok()?;
    let version =
        serde_json::from_str::<serde_json::Value>(&text).ok()?["layer"]["api_version"].as_str()?.to_owned();
    let version: Vec<u32> = version.split('.').filter_map(|n| n.parse().ok()).collect();
    (version.as_slice() >= OLDEST_LAYER_WITH_QUEUE_SYNC.as_slice())
        .then(|| system.parent().map(Path::to_owned))?
}

fn two_queues_manifest() -> PathBuf {
    manifest("VK_LAYER_TEST_two_queues", &library("two_queues"), &[])
}

/// A library for tests: cargo builds it beside the test binary, as a dependency of it.
fn library(name: &str) -> PathBuf {
    let file = format!("{}{name}{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX);
    let library = env::current_exe().unwrap().with_file_name(file);
    assert!(library.is_file(), "{} is missing: `cargo test` builds it", library.display());
    library
}

/// Writes the manifest of a layer into a folder of its own; returns the folder.
fn manifest(name: &str, library: &Path, extensions: &[serde_json::Value]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&folder).unwrap();
    let text = serde_json::json!({
        "file_format_version": "1.2.0",
        "layer": {
            "name": name,
            "type": "GLOBAL",
            "library_path": library,
            "api_version": "1.3.239",
            "implementation_version": "1",
            "description": "for the tests",
            "instance_extensions": extensions,
        }
    });
    // Whole or not at all: other tests write and read it at the same time.
    let temporary = tempfile::NamedTempFile::new_in(&folder).unwrap();
    fs::write(temporary.path(), text.to_string()).unwrap();
    temporary.persist(folder.join("layer.json")).unwrap();
    folder
}
