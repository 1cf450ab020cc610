//! The reader of Rust text that the other tests here stand on.

use beampose_tests::{code, words};

#[track_caller]
fn check(text: &str, expect: &[&str]) {
    let blanked = code(text);
    assert_eq!(blanked.len(), text.len());
    assert_eq!(blanked.matches('\n').count(), text.matches('\n').count());
    assert_eq!(words(&blanked).map(|(_, word)| word).collect::<Vec<_>>(), expect);
}

#[test]
fn comments_and_strings_are_no_code() {
    check("a // b\nc /* d\ne */ f", &["a", "c", "f"]);
    check(r#"a("b \" c", d)"#, &["a", "d"]);
    check(r##"a(r#"b " c"#, br"d\", e)"##, &["a", "e"]);
    check(r"a('b', '\'', '\u{41}', 'ü') c", &["a", "c"]);
    check(
        "fn a<'b>(c: &'b str) -> &'static str",
        &["fn", "a", "b", "c", "b", "str", "static", "str"],
    );
    check("for_r\"b\" c", &["for_r", "c"]);
}

#[test]
fn tests_within_a_file_are_no_part_of_the_program() {
    let program = beampose_tests::program();
    let of = |path: &str| program.iter().find(|s| s.path == path);
    // These have `mod tests` behind `#[cfg(test)]`: in the file, and in files of their own.
    let inside = of("crates/app/src/cli/mod.rs").unwrap();
    assert!(inside.text.contains("enum Command") && !inside.text.contains("debug_assert"));
    assert!(of("crates/store/src/open.rs").is_some());
    assert!(of("crates/store/src/tests/opening.rs").is_none());
    assert!(of("crates/photogrammetry/src/detect/testing.rs").is_none());
    // The drivers' crate has no folder `src`.
    assert!(of("drivers/zaber/driver.rs").is_some() && of("drivers/lib.rs").is_some());
    assert!(of("drivers/folder_camera/driver/tests.rs").is_none());
    assert!(of("drivers/tests/conformance.rs").is_none());
}
