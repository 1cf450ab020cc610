//! The watched folder with a tethering program that is not ours: the `gphoto2` program releases a
//! simulated camera on the network, downloads, and drops the file.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use beampose_core::VirtualClock;
use beampose_drivers::sim::{Hosted, Part, Simulated, TestShutter};
use beampose_drivers::transport::Address;
use beampose_drivers::{Connected, Options, Role, Setting, Simulator};

const ROLE: Role = Role::Camera { exposure: None, delivery: Some(Duration::from_secs(5)) };

fn network_camera(clock: &VirtualClock) -> Box<dyn Hosted> {
    let driver = beampose_drivers::find("camera", "gphoto2").unwrap();
    let Simulator::Hosted(make) = driver.simulator else { unreachable!() };
    make(&[Simulated {
        name: "left".to_owned(),
        options: Options::read(driver.options, &BTreeMap::new()).unwrap(),
        role: ROLE,
        part: Part::Shutter(Arc::new(TestShutter::default())),
        clock: Arc::new(clock.clone()),
    }])
    .unwrap()
}

#[test]
fn pictures_that_the_gphoto2_program_drops_are_those_of_their_releases() {
    if Command::new("gphoto2").arg("--version").output().is_err() {
        let why = "not tried here: a folder filled by gphoto2: that program is not installed";
        let _ = writeln!(std::io::stderr(), "{why}");
        return;
    }
    let clock = VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH);
    let hosted = network_camera(&clock);
    let Some(Address::Device(port)) = hosted.address("left") else { unreachable!() };
    let (folder, home) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let release = format!(
        "env HOME={} gphoto2 --port {port} --camera 'PTP/IP Camera' --capture-image-and-download \
         --keep --filename {}/%f.%C",
        home.path().display(),
        folder.path().display()
    );
    let driver = beampose_drivers::find("camera", "folder").unwrap();
    let written = BTreeMap::from([("release".to_owned(), release)]);
    let setting = Setting {
        name: "left".to_owned(),
        address: Address::Folder(folder.path().to_owned()),
        line: None,
        clock: Arc::new(clock.clone()),
        options: Options::read(driver.options, &written).unwrap(),
        role: ROLE,
        deadline: Duration::from_millis(500),
        simulated: true,
        scratch: home.path().to_owned(),
    };
    let Connected::Camera(camera) = (driver.connect)(setting).unwrap() else { unreachable!() };
    for shot in 0..3 {
        let frame = futures::executor::block_on(clock.drive(Box::pin(async {
            camera.arm().await.unwrap();
            camera.trigger().await.unwrap()
        })));
        assert!(frame.bytes == TestShutter::picture(shot), "picture {shot}, byte for byte");
    }
    let why = "folder filled by the gphoto2 program: 3 pictures of 3 releases, byte for byte";
    let _ = writeln!(std::io::stderr(), "{why}");
}
