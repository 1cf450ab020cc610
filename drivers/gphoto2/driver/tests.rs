//! The driver before helpers that are shell scripts: what goes wrong with a program that should
//! answer lines.

use std::os::unix::fs::PermissionsExt as _;

use beampose_core::VirtualClock;

use super::super::CAMERA;
use super::*;
use crate::options::Options;

/// Ready, and told to keep the pictures.
const BEGIN: &str = r#"printf 'READY\tCanon R5\t123\n'; read it; echo OK"#;

struct Scripted {
    folder: tempfile::TempDir,
    clock: VirtualClock,
    camera: Gphoto2Camera,
}

/// A camera whose helper is this script; each of its starts is a line in `starts`.
fn scripted(script: &str) -> Scripted {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("helper");
    let here = folder.path().display();
    let text = format!("#!/bin/sh\ncd {here}; echo $1 >>starts\n{script}\n");
    std::fs::write(&program, text).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
    let setting = Setting {
        name: "left".to_owned(),
        address: Address::Device("usb:001,002".to_owned()),
        line: None,
        clock: Arc::new(clock.clone()),
        options: Options::read(CAMERA.options, &std::collections::BTreeMap::new()).unwrap(),
        role: Role::Camera { exposure: None, delivery: Some(Duration::from_millis(10)) },
        deadline: Duration::from_millis(80),
        simulated: false,
        scratch: folder.path().to_owned(),
    };
    let mut camera = camera(setting, Some(program)).unwrap();
    camera.wait = Duration::from_millis(300);
    Scripted { folder, clock, camera }
}

impl Scripted {
    fn run<'a, T: Send + 'a>(&self, future: impl Future<Output = T> + Send + 'a) -> T {
        futures::executor::block_on(self.clock.drive(Box::pin(future)))
    }

    fn trigger(&self) -> Result<Vec<u8>, InstrumentError> {
        self.run(self.camera.trigger()).map(|frame| frame.bytes)
    }
}

#[test]
fn a_picture_comes_with_its_bytes() {
    let it = scripted(&format!(
        "{BEGIN}; read it; printf 'LATE\\told.jpg\\n'; echo OK
        read word; echo \"$word\" >asked
        printf 'RELEASED\\t1\\nPICTURE\\t6\\ta.jpg\\nab\\ncd\\nOK\\n'; read it"
    ));
    it.run(it.camera.arm()).unwrap();
    assert_eq!(it.trigger().unwrap(), b"ab\ncd\n");
    let identity = it.run(it.camera.identify()).unwrap();
    assert_eq!((identity.model.as_str(), identity.serial.as_deref()), ("Canon R5", Some("123")));
    let read = |name: &str| std::fs::read_to_string(it.folder.path().join(name)).unwrap();
    assert!(read("asked").starts_with("TRIGGER ") && read("asked").ends_with(" 0 500\n"));
    assert_eq!(read("starts"), "usb:001,002\n");
}

#[test]
fn a_picture_that_does_not_come_costs_the_session_and_is_missing() {
    let it = scripted(&format!(
        "{BEGIN}; read word; echo \"$word\" >>asked; printf 'RELEASED\\t1\\n'
        if test $(wc -l <starts) -gt 1; then printf 'PICTURE\\t1\\ta.jpg\\nx'; fi; read it"
    ));
    assert_eq!(it.trigger(), Err(InstrumentError::Timeout(Duration::from_millis(300))));
    assert_eq!(it.trigger().unwrap(), b"x");
    let asked = std::fs::read_to_string(it.folder.path().join("asked")).unwrap();
    let ends: Vec<_> = asked.lines().filter_map(|line| line.splitn(3, ' ').last()).collect();
    assert_eq!(ends, ["0 500", "1 500"]);
}

#[test]
fn a_refusal_keeps_the_session() {
    let it = scripted(&format!(
        "{BEGIN}; read it; printf 'ERROR\\trefused\\tout of focus\\n'
        read it; printf 'RELEASED\\t1\\nPICTURE\\t1\\ta.jpg\\nx'; read it"
    ));
    assert_eq!(it.trigger(), Err(InstrumentError::Refused("out of focus".to_owned())));
    assert_eq!(it.trigger().unwrap(), b"x");
}

#[test]
fn what_is_wrong_with_a_helper_is_said() {
    for (script, part) in [
        ("echo 'no libgphoto2.so.6' >&2", "no libgphoto2.so.6"),
        ("printf 'ERROR\\tgone\\tCould not find the device\\n'", "another program"),
        ("echo hello; read it", "hello"),
        ("printf 'READY\\ta\\tb\\n'; read it; echo OK; read it; echo what", "what"),
        (
            "printf 'READY\\ta\\tb\\n'; read it; echo OK; read it
            printf 'RELEASED\\t1\\nPICTURE\\t9\\ta.jpg\\nhalf'",
            "has ended",
        ),
    ] {
        let error = scripted(script).trigger().unwrap_err().to_string();
        assert!(error.contains(part), "{script}: {error}");
    }
}

#[test]
fn a_camera_that_needs_a_device_says_so() {
    let it = scripted("");
    let (clock, scratch) = (Arc::new(it.clock.clone()), it.folder.path().to_owned());
    let setting = Setting {
        name: "left".to_owned(),
        address: Address::Folder("pictures".into()),
        line: None,
        clock,
        options: Options::default(),
        role: Role::Camera { exposure: None, delivery: None },
        deadline: Duration::from_millis(80),
        simulated: false,
        scratch,
    };
    let error = connect(setting).err().unwrap().to_string();
    assert!(error.contains("device:usb:001,002"), "{error}");
}
