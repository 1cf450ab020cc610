//! The driver before a folder that a script fills: pictures in time, late, half written, lost.

use std::collections::BTreeMap;
use std::fs::write;

use beampose_core::VirtualClock;
use futures::future::join;

use super::super::CAMERA;
use super::*;
use crate::options::Options;

const LATE: &[u8] = &[0xff, 0xd8, 0xff, 0xe0, 1, 0xff, 0xd9];
const OWN: &[u8] = &[0xff, 0xd8, 0xff, 0xe0, 2, 0xff, 0xd9];

/// A folder with a picture in it, which a script fills.
struct Watched {
    folder: tempfile::TempDir,
    clock: VirtualClock,
    camera: Arc<dyn Camera>,
}

impl Watched {
    fn new(options: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path().join("IMG_0001.JPG"), LATE).unwrap();
        let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
        let written: BTreeMap<String, String> = options
            .iter()
            .map(|(key, value)| {
                let value = value.replace("FOLDER", &folder.path().to_string_lossy());
                ((*key).to_owned(), value)
            })
            .collect();
        let setting = Setting {
            name: "left".to_owned(),
            address: Address::Folder(folder.path().to_owned()),
            line: None,
            clock: Arc::new(clock.clone()),
            options: Options::read(CAMERA.options, &written).unwrap(),
            role: Role::Camera { exposure: None, delivery: Some(Duration::from_secs(1)) },
            deadline: Duration::from_millis(80),
            simulated: false,
            scratch: folder.path().to_owned(),
        };
        let Connected::Camera(camera) = connect(setting).unwrap() else { unreachable!() };
        Self { folder, clock, camera }
    }

    fn drop(&self, name: &str, bytes: &[u8]) {
        write(self.folder.path().join(name), bytes).unwrap();
    }

    async fn drop_after(&self, ms: u64, name: &str, bytes: &[u8]) {
        self.clock.sleep(Duration::from_millis(ms)).await;
        self.drop(name, bytes);
    }

    fn run<'a, T: Send + 'a>(&self, future: impl Future<Output = T> + Send + 'a) -> T {
        futures::executor::block_on(self.clock.drive(Box::pin(future)))
    }

    fn trigger(&self) -> Result<Vec<u8>, InstrumentError> {
        self.run(self.camera.trigger()).map(|frame| frame.bytes)
    }

    fn has(&self, name: &str) -> bool {
        self.folder.path().join(name).exists()
    }
}

#[test]
fn a_picture_that_comes_after_the_trigger_is_its_own() {
    let it = Watched::new(&[]);
    let come = it.drop_after(710, "IMG_0002.JPG", OWN);
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    let frame = frame.unwrap();
    assert_eq!(frame.bytes, OWN);
    // Dropped between two looks: one finds it, the next finds it unchanged.
    assert_eq!(frame.delivered.monotonic, Duration::from_millis(740));
    assert!(it.has("IMG_0002.JPG"));
}

#[test]
fn a_picture_is_read_when_all_of_it_is_there() {
    let it = Watched::new(&[("keep", "false")]);
    let come = async {
        it.drop_after(100, "IMG_0002.JPG", &OWN[..3]).await;
        it.drop_after(300, "IMG_0002.JPG.part", OWN).await;
        it.drop_after(300, "IMG_0002.JPG", OWN).await;
    };
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    assert_eq!(frame.unwrap().bytes, OWN);
    assert!(!it.has("IMG_0002.JPG") && it.has("IMG_0001.JPG"));
}

#[test]
fn half_a_picture_is_an_error_that_names_it() {
    let it = Watched::new(&[]);
    let come = it.drop_after(100, "IMG_0002.JPG", &OWN[..3]);
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    let error = frame.unwrap_err().to_string();
    assert!(error.contains("IMG_0002.JPG, 3 bytes"), "{error}");
}

#[test]
fn a_late_picture_is_not_taken_for_the_next_one() {
    // Between the timeout and the next arm; while arm waits for it; between arm and trigger.
    for moment in 0..3 {
        let it = Watched::new(&[("release", "sh -c 'echo >>FOLDER/shots'")]);
        assert_eq!(it.trigger(), Err(InstrumentError::Timeout(Duration::from_secs(4))));
        if moment == 0 {
            it.drop("IMG_0002.JPG", LATE);
        }
        let late = async {
            if moment == 1 {
                it.drop_after(1500, "IMG_0002.JPG", LATE).await;
            }
        };
        let (armed, ()) = it.run(join(it.camera.arm(), late));
        armed.unwrap();
        if moment == 2 {
            it.drop("IMG_0002.JPG", LATE);
        }
        let come = it.drop_after(300, "IMG_0003.JPG", OWN);
        let (frame, ()) = it.run(join(it.camera.trigger(), come));
        assert_eq!(frame.unwrap().bytes, OWN, "moment {moment}");
        assert!(it.has("IMG_0002.JPG"), "a late picture is left alone");
    }
}

#[test]
fn a_late_picture_ahead_of_the_next_is_passed_over() {
    let it = Watched::new(&[]);
    assert!(it.trigger().is_err());
    let come = async {
        it.clock.sleep(Duration::from_millis(4500)).await;
        it.drop_after(0, "IMG_0002.JPG", LATE).await;
        it.drop_after(400, "IMG_0003.JPG", OWN).await;
    };
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    assert_eq!(frame.unwrap().bytes, OWN);
    // All is known again: no more waiting for others.
    let since = it.clock.now().monotonic;
    let come = it.drop_after(110, "IMG_0004.JPG", OWN);
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    assert_eq!(frame.unwrap().delivered.monotonic - since, Duration::from_millis(140));
}

#[test]
fn a_trigger_that_was_given_up_counts_as_missing() {
    let it = Watched::new(&[]);
    it.run(async {
        let limit = Duration::from_millis(200);
        assert!(beampose_core::clock::within(&it.clock, limit, it.camera.trigger()).await.is_err());
    });
    it.drop("IMG_0002.JPG", LATE);
    let come = it.drop_after(300, "IMG_0003.JPG", OWN);
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    assert_eq!(frame.unwrap().bytes, OWN);
}

#[test]
fn two_pictures_for_one_release_are_refused() {
    let it = Watched::new(&[]);
    let come = async {
        it.drop_after(110, "IMG_0002.JPG", LATE).await;
        it.drop("IMG_0003.JPG", OWN);
    };
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    let error = frame.unwrap_err().to_string();
    assert!(error.contains("IMG_0002.JPG, IMG_0003.JPG"), "{error}");
}

#[test]
fn a_command_that_takes_the_picture_is_waited_for() {
    let it = Watched::new(&[("release", "cp FOLDER/source.bin FOLDER/IMG_0002.JPG")]);
    it.drop("source.bin", OWN);
    assert_eq!(it.trigger().unwrap(), OWN);
    let gone = Watched::new(&[("release", "cp FOLDER/none FOLDER/IMG_0002.JPG")]);
    let error = gone.trigger().unwrap_err().to_string();
    assert!(error.contains("none"), "{error}");
}

#[test]
fn a_file_that_is_no_picture_is_an_error() {
    let it = Watched::new(&[]);
    let come = it.drop_after(100, "IMG_0002.JPG", b"<html>\xff\xd9");
    let (frame, ()) = it.run(join(it.camera.trigger(), come));
    assert!(matches!(frame, Err(InstrumentError::Garbled { .. })));
}

#[test]
fn a_folder_that_is_gone_is_named() {
    let it = Watched::new(&[]);
    std::fs::remove_dir_all(it.folder.path()).unwrap();
    let error = it.run(it.camera.identify()).unwrap_err().to_string();
    assert!(error.contains("share"), "{error}");
}
