//! Compiles `shaders/*.comp` (and those of the tests), `*.vert` and `*.frag` into SPIR-V words that the crate includes.
//!
//! `glslc` does the work, or the `shaderc` crate with the cargo feature of that name. A shader with
//! an `#ifdef POOL_SSBO`, itself or in an include, is compiled as `NAME`, and as `NAME_SSBO` with it; so with
//! `POOL_TEXELS`, and with `LOGGED` (what a benchmark counts); with `#ifdef STACKED` there are all but the last of these a
//! second time, `NAME_STACKED…` (what floats is looked for); with `#ifdef SMOOTH` a third time, `NAME_SMOOTH…`, with both
//! defined (and tops are a smooth surface).
//! The constants that Rust and the shaders share come from the table in `build/constants.rs`.
//! Release builds learn the commit they are built from, for the reports of benchmarks.

#[path = "build/constants.rs"]
mod constants;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, process};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    write_constants(&out).unwrap_or_else(|e| fail(&format!("{}: {e}", out.display())));
    // The tests' own shaders are in a module of their own, so that the library does not carry them.
    for (folder, module) in [("shaders", "shaders.rs"), ("tests/shaders", "test_shaders.rs")] {
        println!("cargo::rerun-if-changed={folder}");
        let text = compile_folder(Path::new(folder), &out).unwrap_or_else(|message| fail(&message));
        fs::write(out.join(module), text).unwrap_or_else(|e| fail(&format!("{module}: {e}")));
    }
    // A debug build would be rebuilt after each commit, for nothing.
    if env::var("PROFILE").is_ok_and(|profile| profile == "release")
        && let Some(commit) = commit()
    {
        println!("cargo::rustc-env=LASRAY_COMMIT={commit}");
    }
}

/// The table for Rust, for the shaders (in the folder that [`includes`] names), and as text for the documentation.
fn write_constants(out: &Path) -> std::io::Result<()> {
    // What was written for a group of another name is not to be found.
    let _ = fs::remove_dir_all(includes(out));
    fs::create_dir_all(includes(out))?;
    for (name, text) in constants::glsl() {
        // An include beside the shader would be found first.
        if Path::new("shaders").join(&name).exists() {
            return Err(std::io::Error::other(format!("shaders/{name} hides the include of that name")));
        }
        fs::write(includes(out).join(name), text)?;
    }
    fs::write(out.join("shared.rs"), constants::rust())?;
    fs::write(out.join("payload.txt"), constants::drawing())
}

/// Where the includes are that are written here.
fn includes(out: &Path) -> PathBuf {
    out.join("include")
}

/// The commit, with `-dirty` where files differ from it. `None` without git, and in a package, whatever repository it
/// lies in.
fn commit() -> Option<String> {
    if !Path::new(".git").exists() {
        return None;
    }
    let git = |arguments: &[&str]| {
        let run =
            process::Command::new("git").env("GIT_OPTIONAL_LOCKS", "0").args(arguments).output().ok()?;
        run.status.success().then(|| String::from_utf8_lossy(&run.stdout).trim().to_owned())
    };
    // The log of HEAD grows with each commit and checkout. A path that is not there would mean: always.
    for name in ["logs/HEAD", "HEAD"] {
        let path = git(&["rev-parse", "--git-path", name])?;
        if Path::new(&path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    // What makes it dirty.
    for path in ["src", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={path}");
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() { commit } else { commit + "-dirty" })
}

fn fail(message: &str) -> ! {
    // One cargo line holds one line of text.
    for line in message.lines() {
        println!("cargo::error={line}");
    }
    process::exit(1);
}

/// Every shader of `folder` as Rust source: `pub static NAME: &[u32]`, for `NAME.vert` and `NAME.frag` `NAME_VERT` and
/// `NAME_FRAG`.
fn compile_folder(folder: &Path, out: &Path) -> Result<String, String> {
    let mut sources: Vec<PathBuf> = match fs::read_dir(folder) {
        Ok(entries) => entries.flatten().map(|e| e.path()).collect(),
        Err(_) => Vec::new(), // a published package has no tests
    };
    sources.retain(|p| p.extension().is_some_and(|e| e == "comp" || e == "vert" || e == "frag"));
    sources.sort();
    let mut text = String::new();
    for source in &sources {
        let stem = source.file_stem().and_then(|s| s.to_str()).ok_or("a shader's name is not UTF-8")?;
        let stage = match source.extension().and_then(|e| e.to_str()) {
            Some(stage @ ("vert" | "frag")) => format!("_{}", stage.to_uppercase()),
            _ => String::new(),
        };
        let asks = |define: &str| asks_for(source, &format!("#ifdef {define}"), 0);
        let mut variants = vec![(stem.to_uppercase() + &stage, vec![])];
        let mut surfaces: Vec<(&str, Vec<&str>)> = Vec::new();
        if asks("STACKED")? {
            surfaces.push(("STACKED", vec!["STACKED"]));
        }
        if asks("SMOOTH")? {
            surfaces.push(("SMOOTH", vec!["STACKED", "SMOOTH"]));
        }
        for (name, defines) in &surfaces {
            variants.push((format!("{}_{name}", stem.to_uppercase()), defines.clone()));
        }
        for (suffix, define) in [("SSBO", "POOL_SSBO"), ("TEXELS", "POOL_TEXELS"), ("LOGGED", "LOGGED")] {
            // The baseline goes by address alone.
            if (stem != "thesis" || define == "LOGGED") && asks(define)? {
                variants.push((format!("{}_{suffix}", stem.to_uppercase()), vec![define]));
                for (name, defines) in surfaces.iter().filter(|_| define != "LOGGED") {
                    let name = format!("{}_{name}_{suffix}", stem.to_uppercase());
                    variants.push((name, [&defines[..], &[define]].concat()));
                }
            }
        }
        for (name, defines) in variants {
            let words = compile(source, &defines, out)?;
            let shown = source.display();
            let with = match &defines[..] {
                [] => String::new(),
                defines => format!(" with `{}` defined", defines.join("`, `")),
            };
            let _ = writeln!(text, "/// `{shown}`{with}.\npub static {name}: &[u32] = &{words:?};");
        }
    }
    Ok(text)
}

/// Whether `source`, or what it includes, has the line `line`.
fn asks_for(source: &Path, asked: &str, depth: u32) -> Result<bool, String> {
    let text = fs::read_to_string(source).map_err(|e| format!("{}: {e}", source.display()))?;
    for line in text.lines().map(str::trim_start).filter(|line| line.starts_with('#')) {
        if line == asked {
            return Ok(true);
        }
        let Some(name) = line.strip_prefix("#include").and_then(|l| l.split('"').nth(1)) else { continue };
        let beside = source.parent().unwrap_or(Path::new("")).join(name);
        let file = [beside, Path::new("shaders").join(name)].into_iter().find(|p| p.is_file());
        if let Some(file) = file
            && depth < 16
            && asks_for(&file, asked, depth + 1)?
        {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(not(feature = "shaderc"))]
fn compile(source: &Path, defines: &[&str], out: &Path) -> Result<Vec<u32>, String> {
    let spirv = out.join("shader.spv");
    let mut command = process::Command::new("glslc");
    command.args(["--target-env=vulkan1.3", "-O", "-Werror", "-I", "shaders", "-I"]).arg(includes(out));
    command.arg("-o").arg(&spirv).arg(source);
    command.args(defines.iter().map(|define| format!("-D{define}")));
    let run = command.output().map_err(|e| {
        format!(
            "cannot run glslc ({e}): install the package `glslc` (Debian, Ubuntu), `shaderc` (Fedora, Arch, \
             Homebrew) or the Vulkan SDK (https://vulkan.lunarg.com), or build with `--features shaderc`"
        )
    })?;
    if !run.status.success() {
        return Err(format!("{}:\n{}", source.display(), String::from_utf8_lossy(&run.stderr)));
    }
    let bytes = fs::read(&spirv).map_err(|e| format!("{}: {e}", spirv.display()))?;
    Ok(bytes.chunks_exact(4).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]])).collect())
}

#[cfg(feature = "shaderc")]
fn compile(source: &Path, defines: &[&str], out: &Path) -> Result<Vec<u32>, String> {
    use shaderc::{
        CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, TargetEnv,
    };
    let text = fs::read_to_string(source).map_err(|e| format!("{}: {e}", source.display()))?;
    let compiler = Compiler::new().map_err(|e| format!("shaderc: {e}"))?;
    let mut options = CompileOptions::new().map_err(|e| format!("shaderc: {e}"))?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(OptimizationLevel::Performance);
    options.set_warnings_as_errors();
    defines.iter().for_each(|define| options.add_macro_definition(define, None));
    options.set_include_callback(|name, _, from, _| {
        let beside = Path::new(from).parent().unwrap_or(Path::new("")).join(name);
        let places = [beside, Path::new("shaders").join(name), includes(out).join(name)];
        let path = places.iter().find(|p| p.is_file()).unwrap_or(&places[1]);
        let content = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(ResolvedInclude { resolved_name: path.to_string_lossy().into_owned(), content })
    });
    let name = source.to_string_lossy();
    let kind = match source.extension().and_then(|e| e.to_str()) {
        Some("vert") => ShaderKind::Vertex,
        Some("frag") => ShaderKind::Fragment,
        _ => ShaderKind::Compute,
    };
    compiler
        .compile_into_spirv(&text, kind, &name, "main", Some(&options))
        .map(|artifact| artifact.as_binary().to_vec())
        .map_err(|e| e.to_string())
}
