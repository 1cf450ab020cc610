//! Processings, poses, results; and the truth, apart.

use std::collections::BTreeMap;

use beampose_core::{Pose, SessionId};

use super::{Fresh, fresh, p000, session};
use crate::{
    NewProcessing, PoseRow, ProcessingId, ResultRow, SolutionRow, Store, StoreError, truth,
};

pub(super) fn new(session: SessionId) -> NewProcessing {
    NewProcessing {
        session,
        created: "2026-03-01T09:00:00Z".parse().unwrap(),
        software: "0.1.0".to_owned(),
        options_json: "{\"methods\":[\"virtual-camera\"]}".to_owned(),
        lineage_json: "{\"pattern\":\"00ff\"}".to_owned(),
        measurement_json: None,
        files: Vec::new(),
        batch: None,
    }
}

fn pose() -> Pose {
    let mut covariance = [[0.0; 6]; 6];
    for (i, row) in covariance.iter_mut().enumerate() {
        row[i] = 0.1 / (i as f64 + 3.0);
    }
    let position_mm = [1.0 / 3.0, -2000.25, 1e-17];
    Pose { position_mm, quaternion_wxyz: [0.5, -0.5, 0.5, -0.5], covariance }
}

fn row(method: &str, pose: Result<Pose, String>) -> PoseRow {
    PoseRow {
        capture: p000(),
        method: method.to_owned(),
        pose,
        beams_used: 117,
        sigma0: 1.05,
        wavelength_nm: 658.02,
        wavelength_source: Some("interpolated".to_owned()),
        wavelength_u_nm: Some(0.03),
        wavelength_age_s: Some(12.5),
        ambiguous: true,
    }
}

pub(super) fn solution() -> SolutionRow {
    let failed = row("inter-beam-angles", Err("too few beams: 3".to_owned()));
    SolutionRow {
        capture: p000(),
        seconds_json: "{\"decode\":0.1}".to_owned(),
        solution_json: "{\"notes\":[]}".to_owned(),
        poses: vec![failed, row("virtual-camera", Ok(pose()))],
        observations_json: BTreeMap::from([("cam_a".to_owned(), "[[1,2.5]]".to_owned())]),
    }
}

fn later() -> jiff::Timestamp {
    "2026-03-01T09:05:00Z".parse().unwrap()
}

async fn started() -> (Fresh, SessionId, ProcessingId) {
    let fresh = fresh().await;
    let session = session(&fresh.store).await;
    let processing = fresh.store.start_processing(&new(session)).await.unwrap();
    (fresh, session, processing)
}

/// A finished processing of `session`.
pub(super) async fn solve(store: &Store, session: SessionId) -> ProcessingId {
    let processing = store.start_processing(&new(session)).await.unwrap();
    store.save_solution(processing, &solution()).await.unwrap();
    store.finish_processing(processing, later()).await.unwrap();
    processing
}

#[tokio::test]
async fn a_solution_comes_back_as_it_was_stored() {
    let (fresh, session, processing) = started().await;
    let store = &fresh.store;
    store.save_solution(processing, &solution()).await.unwrap();
    store.finish_processing(processing, later()).await.unwrap();
    assert_eq!(store.poses(processing).await.unwrap(), solution().poses);
    assert_eq!(store.solution(processing, &p000()).await.unwrap(), solution());
    let latest = store.latest_processing(session).await.unwrap().unwrap();
    assert_eq!(
        (latest.id, latest.start, latest.finished),
        (processing, new(session), Some(later()))
    );
    assert_eq!(store.sessions().await.unwrap()[0].solved, 1);
}

#[tokio::test]
async fn numbers_in_json_come_back_to_the_bit() {
    let (fresh, _, processing) = started().await;
    let mut exact = solution();
    let covariance = &mut exact.poses[1].pose.as_mut().unwrap().covariance;
    for (i, value) in covariance.iter_mut().flatten().enumerate() {
        *value = (i as f64 + 0.1).sqrt() * 10f64.powi(i as i32 - 18);
    }
    fresh.store.save_solution(processing, &exact).await.unwrap();
    assert_eq!(fresh.store.poses(processing).await.unwrap(), exact.poses);
}

#[tokio::test]
async fn a_processing_never_overwrites_another() {
    let (fresh, session, first) = started().await;
    let store = &fresh.store;
    store.save_solution(first, &solution()).await.unwrap();
    store.finish_processing(first, later()).await.unwrap();
    let second = store.start_processing(&new(session)).await.unwrap();
    store.save_solution(second, &solution()).await.unwrap();
    assert_eq!(store.poses(first).await.unwrap(), store.poses(second).await.unwrap());
    // One under way does not hide one that is complete.
    assert_eq!(store.latest_processing(session).await.unwrap().unwrap().id, first);
    store.finish_processing(second, later()).await.unwrap();
    assert_eq!(store.latest_processing(session).await.unwrap().unwrap().id, second);
}

#[track_caller]
fn refused<T: std::fmt::Debug>(answer: Result<T, StoreError>) {
    let error = answer.unwrap_err();
    assert!(matches!(error, StoreError::Refused { .. }), "{error}");
}

#[tokio::test]
async fn what_does_not_belong_is_refused() {
    let (fresh, _, processing) = started().await;
    let store = &fresh.store;
    refused(store.start_processing(&new(SessionId::fresh())).await);
    let unknown = SolutionRow { capture: "p999".into(), poses: Vec::new(), ..solution() };
    refused(store.save_solution(processing, &unknown).await);
    let no_json = SolutionRow { solution_json: "notes".to_owned(), ..solution() };
    refused(store.save_solution(processing, &no_json).await);
    let mut no_number = solution();
    no_number.poses[1].pose.as_mut().unwrap().position_mm[0] = f64::NAN;
    refused(store.save_solution(processing, &no_number).await);
    assert!(store.poses(processing).await.unwrap().is_empty(), "a capture is stored whole");
    store.save_solution(processing, &solution()).await.unwrap();
    refused(store.save_solution(processing, &solution()).await);
    store.finish_processing(processing, later()).await.unwrap();
    refused(store.finish_processing(processing, later()).await);
    refused(store.save_solution(processing, &solution()).await);
}

#[tokio::test]
async fn a_failed_pose_needs_no_numbers() {
    let (fresh, _, processing) = started().await;
    let mut failed = solution();
    failed.poses.truncate(1);
    (failed.poses[0].sigma0, failed.poses[0].wavelength_nm) = (f64::NAN, f64::NAN);
    fresh.store.save_solution(processing, &failed).await.unwrap();
    let stored = &fresh.store.poses(processing).await.unwrap()[0];
    assert_eq!(stored.pose, Err("too few beams: 3".to_owned()));
    assert!(stored.sigma0.is_nan() && stored.wavelength_nm.is_nan());
    assert_eq!(fresh.store.sessions().await.unwrap()[0].solved, 0);
}

#[tokio::test]
async fn results_stand_beside_each_other() {
    let (fresh, _, processing) = started().await;
    let results: Vec<_> = ["{\"scale\":1}", "{\"scale\":2}"]
        .map(|json| ResultRow { processing, created: later(), result_json: json.to_owned() })
        .into();
    for result in &results {
        fresh.store.save_result(result).await.unwrap();
    }
    assert_eq!(fresh.store.results(processing).await.unwrap(), results);
}

#[tokio::test]
async fn the_truth_is_apart() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let id = session(store).await;
    truth::save_capture(store, id, &p000(), "{\"x_mm\":12.5}").await.unwrap();
    truth::save_parameters(store, id, "{\"k1\":3.5e-8}").await.unwrap();
    let captures = truth::captures(store, id).await.unwrap();
    assert_eq!(captures, BTreeMap::from([(p000(), "{\"x_mm\":12.5}".to_owned())]));
    let parameters = truth::parameters(store, id).await.unwrap();
    assert_eq!(parameters.as_deref(), Some("{\"k1\":3.5e-8}"));
    refused(truth::save_parameters(store, id, "{}").await);
    refused(truth::save_capture(store, id, &"p999".into(), "{}").await);
    no_other_module_knows_of_the_truth(store).await;
}

/// Its tables are referred to by no other table, and named in no other module.
async fn no_other_module_knows_of_the_truth(store: &Store) {
    let referring: Vec<String> = sqlx::query_scalar(
        "SELECT m.name FROM sqlite_schema m, pragma_foreign_key_list(m.name) k
         WHERE k.\"table\" LIKE 'simulation_truth%'",
    )
    .fetch_all(&store.readers)
    .await
    .unwrap();
    assert!(referring.is_empty(), "{referring:?}");
    let mut modules = 0;
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() && !path.ends_with("truth.rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(!text.contains("simulation_truth"), "{}", path.display());
            modules += 1;
        }
    }
    assert!(modules > 5);
}
