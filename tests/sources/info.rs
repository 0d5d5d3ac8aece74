//! `lasray info` on real files: classes and bounds as other programs count them.

use crate::scene::real_files as data;
use serde_json::Value;
use std::process::Command;

/// Exit code, standard output, standard error.
fn info(words: &[&std::ffi::OsStr]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_lasray")).arg("info").args(words).output().unwrap();
    let [printed, said] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), printed, said)
}

#[test]
fn classes_and_points() {
    let Some(data) = data() else { return };
    // Counted with other programs.
    let cases = [
        ("urban/fusa.laz", 277_573, vec![(1, 17_553), (2, 180_868), (5, 37_030), (6, 42_122)]),
        ("copc/fusa.copc.laz", 277_573, vec![(1, 17_553), (2, 180_868), (5, 37_030), (6, 42_122)]),
        ("forest/MixedConifer.laz", 37_657, vec![(1, 31_832), (2, 5_820), (11, 5)]),
        ("urban/870000_6618000.subset.50mx100m.las", 70_840, vec![(1, 29_593), (2, 34_316), (6, 6_931)]),
    ];
    for (name, points, classes) in cases {
        let (code, text, _) =
            info(&[data.join(name).as_os_str(), "--scan".as_ref(), "--json".as_ref(), "-".as_ref()]);
        let json: Value = serde_json::from_str(&text).unwrap();
        let scan = &json["files"][0]["scan"];
        assert_eq!((code, scan["points"].as_u64()), (Some(0), Some(points)), "{name}");
        let pair = |class: &Value| (class["class"].as_u64().unwrap(), class["points"].as_u64().unwrap());
        let found: Vec<(u64, u64)> = scan["classes"].as_array().unwrap().iter().map(pair).collect();
        assert_eq!(found, classes, "{name}");
    }
}

#[test]
fn what_fails_is_named() {
    let Some(data) = data() else { return };
    let odd = data.join("odd");
    let (code, _, text) = info(&[odd.as_os_str()]);
    assert_eq!(code, Some(0));
    assert!(text.contains("broken_coder.laz: byte 281"), "{text}");
    let (code, ..) = info(&[odd.as_os_str(), "--strict".as_ref()]);
    assert_eq!(code, Some(1));
    let (code, _, text) = info(&[data.join("hostile/empty_file.las").as_os_str()]);
    assert_eq!(code, Some(1));
    assert!(text.contains("empty file"), "{text}");
    let (code, ..) = info(&[]);
    assert_eq!(code, Some(2));
}
