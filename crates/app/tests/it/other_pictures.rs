//! A session copied into another database, without what solving must not need, or with what it
//! cannot use.

use std::sync::Arc;

use beampose_core::{
    CaptureRecord, Picture, RunSink as _, SessionHeader, SessionId, SessionOutcome, StepOutcome,
    StepRecord,
};
use beampose_store::{Store, StoredCapture};

use crate::lab::{Lab, plan, solutions};

/// Copies the latest session's captures. Its truth and its journal stay behind; the header is as
/// `change` leaves it.
async fn copy(from: Arc<Store>, to: &Store, change: impl FnOnce(&mut SessionHeader)) {
    let id = from.find_session("latest").await.unwrap();
    let mut header = from.session(id).await.unwrap().header;
    change(&mut header);
    to.open(&header).await.unwrap();
    let captures = from.captures(id).await.unwrap();
    for capture in &captures {
        to.step(header.id, &step(&from, id, capture).await).await.unwrap();
    }
    let end = captures.last().unwrap().triggered;
    to.close(header.id, SessionOutcome::Completed, &[], end).await.unwrap();
}

async fn step(from: &Store, id: SessionId, capture: &StoredCapture) -> StepRecord {
    let mut pictures = Vec::new();
    for picture in &capture.pictures {
        pictures.push(Picture {
            camera: picture.camera.clone(),
            bytes: from.picture(id, &capture.id, &picture.camera).await.unwrap(),
            requested: picture.requested,
            delivered: picture.delivered,
        });
    }
    StepRecord {
        number: capture.step,
        label: "copied".to_owned(),
        kind: "capture".to_owned(),
        started: capture.triggered,
        finished: capture.triggered,
        outcome: StepOutcome::Done,
        readings: Vec::new(),
        capture: Some(CaptureRecord {
            id: capture.id.clone(),
            setpoints: capture.setpoints.clone(),
            readings: capture.readings.clone(),
            pictures,
        }),
        missing: Vec::new(),
        answer: None,
        looks: Vec::new(),
        events: Vec::new(),
    }
}

fn copied(lab: &Lab, change: impl FnOnce(&mut SessionHeader)) {
    let to = lab.path("copy.db");
    lab.with_store("beampose.db", async |from| {
        let to = Store::open(&to).await.unwrap();
        copy(from, &to, change).await;
        to.close().await;
    });
}

const SOLVE: [&str; 3] = ["solve", "latest", "--json"];
const COPY: [&str; 2] = ["--db", "copy.db"];

#[test]
fn solving_and_reporting_need_neither_the_truth_nor_the_simulation() {
    let lab = Lab::new();
    lab.run(&plan(1, 200, 100), &[]).expect_code(0);
    copied(&lab, |header| {
        header.rig_text = "gone".to_owned();
        header.seed = None;
    });
    let known = solutions(&lab.beampose(&SOLVE).expect_code(0));
    let unknown = solutions(&lab.beampose(&[&SOLVE[..], &COPY].concat()).expect_code(0));
    assert_eq!(known.len(), 6);
    assert!(known.iter().all(|pose| pose["status"] == "solved"));
    assert_eq!(known, unknown);
    let report = |more: &[&str]| {
        let ended = lab.beampose(&[&["report", "latest", "--json"], more].concat());
        let mut report = ended.expect_code(0).json();
        report["processing"].take();
        report
    };
    assert_eq!(report(&[]), report(&COPY));
    let score = lab.beampose(&[&["score", "latest"], &COPY[..]].concat()).expect_code(2);
    assert!(score.err.contains("has no truth to compare with"), "{}", score.err);
}

#[test]
fn a_picture_of_another_size_than_its_calibration_is_left_out_with_a_note() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    copied(&lab, |header| {
        let mut setup: serde_json::Value = serde_json::from_str(&header.measurement_json).unwrap();
        let width = &mut setup["cameras"]["cam_b"]["model"]["width"];
        *width = (width.as_u64().unwrap() - 100).into();
        header.measurement_json = setup.to_string();
    });
    let poses = solutions(&lab.beampose(&[&SOLVE[..], &COPY].concat()).expect_code(0));
    assert_eq!(poses.len(), 4);
    let note = "cam_b: the picture has 1728 x 1296 pixels, its calibration is for 1628 x 1296";
    for pose in &poses {
        let notes = pose["notes"].as_array().unwrap();
        assert!(notes.iter().any(|n| n == note), "{pose}");
        // The two other cameras do.
        assert_eq!(pose["status"], "solved", "{pose}");
    }
}

#[test]
fn after_a_run_the_database_is_one_file_that_can_be_copied() {
    let lab = Lab::new();
    lab.run(&plan(1, 100, 100), &[]).expect_code(0);
    std::fs::copy(lab.path("beampose.db"), lab.path("copy.db")).unwrap();
    let of = |more: &[&str]| lab.beampose(&[&["sessions", "latest", "--json"], more].concat());
    assert_eq!(of(&COPY).expect_code(0).json(), of(&[]).expect_code(0).json());
}
