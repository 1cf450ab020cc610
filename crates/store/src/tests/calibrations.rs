//! Calibrations: recorded once, found by the hash of their file, never gone; from a pose back to the
//! session that its calibration was made from.

use beampose_core::{RunSink as _, SessionHeader, SessionId};

use super::keeping::full_session;
use super::solving::{new, solution};
use super::{Fresh, fresh, header, session, used};
use crate::{
    Calibration, CalibrationHead, CalibrationKind, CalibrationSource, Kept, Store, StoreError,
};

fn noon() -> jiff::Timestamp {
    "2026-03-02T12:00:00Z".parse().unwrap()
}

/// A fan made from a session, whose text no other session's has.
pub(super) fn fan(session: SessionId) -> Calibration {
    let content = format!("version: 1 # fan of {session}\n");
    let sources = vec![
        CalibrationSource::Session {
            id: session,
            title: "beam angles".to_owned(),
            plan_hash: "00ff".to_owned(),
            processing: Some(noon()),
            kept: Kept::Here,
        },
        CalibrationSource::File { name: "measured.csv".to_owned(), blake3: "0f".repeat(32) },
    ];
    let head = CalibrationHead {
        blake3: blake3::hash(content.as_bytes()).to_hex().to_string(),
        kind: CalibrationKind::Pattern,
        name: "fan".to_owned(),
        method: "rotation stage".to_owned(),
        created: noon(),
        software: "0.1.0".to_owned(),
        sources,
    };
    Calibration {
        head,
        options_json: "{\"plane_mm\":5000.0}".to_owned(),
        content,
        parameters_json: "[{\"name\":\"pitch_mm\",\"value\":52.22,\"u\":0.01}]".to_owned(),
        covariance_json: "[[0.0001]]".to_owned(),
        result_json: "{\"model\":\"radial-grid\"}".to_owned(),
    }
}

/// A session that used a fan, solved once, with the one that the fan was made from.
async fn measured(store: &Store) -> (SessionId, SessionId, Calibration) {
    let source = session(store).await;
    let fan = fan(source);
    store.record_calibration(&fan).await.unwrap();
    let id = SessionId::fresh();
    let files = vec![used(None, &fan.content), used(Some("cam_a"), "unknown")];
    store.open(&SessionHeader { files, ..header(id) }).await.unwrap();
    let picture = vec![super::picture("cam_a", b"wall")];
    store.step(id, &super::step(1, "p000", picture)).await.unwrap();
    let processing = store.start_processing(&new(id)).await.unwrap();
    store.save_solution(processing, &solution()).await.unwrap();
    store.finish_processing(processing, noon()).await.unwrap();
    (source, id, fan)
}

#[track_caller]
fn kept(head: &CalibrationHead) -> Kept {
    match &head.sources[0] {
        CalibrationSource::Session { kept, .. } => *kept,
        other @ CalibrationSource::File { .. } => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn a_calibration_comes_back_as_it_was_recorded_and_is_recorded_once() {
    let Fresh { store, folder: _folder } = fresh().await;
    let fan = fan(session(&store).await);
    assert!(store.record_calibration(&fan).await.unwrap());
    let again = Calibration {
        head: CalibrationHead { name: "other".to_owned(), ..fan.head.clone() },
        ..fan.clone()
    };
    assert!(!store.record_calibration(&again).await.unwrap());
    assert_eq!(store.calibrations().await.unwrap(), std::slice::from_ref(&fan.head));
    for wanted in ["latest", &fan.head.blake3, &fan.head.blake3[..7]] {
        assert_eq!(store.calibration(wanted).await.unwrap(), fan);
    }
    let found = store.calibration_of_file(&fan.head.blake3).await.unwrap();
    assert_eq!(found, Some(fan.head));
    assert_eq!(store.calibration_of_file(&"00".repeat(32)).await.unwrap(), None);
    let error = store.calibration("zz").await.unwrap_err();
    assert!(matches!(error, StoreError::NotFound { .. }), "{error}");
}

#[tokio::test]
async fn what_does_not_have_its_hash_is_not_recorded_and_found_where_it_changed() {
    let Fresh { store, folder: _folder } = fresh().await;
    let id = session(&store).await;
    let fan = fan(id);
    let forged = Calibration { content: "version: 2".to_owned(), ..fan.clone() };
    let error = store.record_calibration(&forged).await.unwrap_err();
    assert!(matches!(error, StoreError::Refused { .. }), "{error}");
    store.record_calibration(&fan).await.unwrap();
    assert!(store.verify(id).await.unwrap().is_sound());
    sqlx::query("UPDATE calibrations SET content_text = content_text || ' '")
        .execute(&mut *store.writer.turn("test").await.unwrap())
        .await
        .unwrap();
    let problems = store.verify(id).await.unwrap().problems;
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(problems[0].starts_with("calibration fan ") && problems[0].contains("its BLAKE3 is"));
    let error = store.calibration("latest").await.unwrap_err();
    assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
}

#[tokio::test]
async fn the_files_of_a_session_and_of_a_processing_that_was_told_others_are_known() {
    let Fresh { store, folder: _folder } = fresh().await;
    let (_, id, fan) = measured(&store).await;
    let told = vec![used(None, "another fan")];
    let other = crate::NewProcessing { files: told.clone(), ..new(id) };
    store.start_processing(&other).await.unwrap();
    let of_session = store.session(id).await.unwrap().header.files;
    assert_eq!(of_session, [used(None, &fan.content), used(Some("cam_a"), "unknown")]);
    let processings = store.processings(id).await.unwrap();
    assert_eq!(processings[0].start.files, []);
    assert_eq!(processings[1].start.files, told);
    // As other programs see them.
    let seen: Vec<(i64, String, Option<String>)> = sqlx::query_as(
        "SELECT processing, kind, calibration FROM v_inputs WHERE session = ?
         ORDER BY processing, kind DESC",
    )
    .bind(id.to_string())
    .fetch_all(&store.readers)
    .await
    .unwrap();
    let [first, second] = [processings[0].id.0, processings[1].id.0];
    let hash = Some(fan.head.blake3);
    assert_eq!(
        seen,
        [
            (first, "pattern".to_owned(), hash),
            (first, "camera".to_owned(), None),
            (second, "pattern".to_owned(), None)
        ]
    );
}

#[tokio::test]
async fn the_record_stays_when_its_session_goes_and_says_so() {
    let Fresh { store, folder: _folder } = fresh().await;
    let (source, id, fan) = measured(&store).await;
    let head = async || store.calibration_of_file(&fan.head.blake3).await.unwrap().unwrap();
    assert_eq!(kept(&head().await), Kept::Here);
    let file = store.path().with_file_name("source.bps");
    store.export_session(source, &file).await.unwrap();
    store.delete_session(source).await.unwrap();
    assert!(matches!(kept(&head().await), Kept::Deleted(_)));
    assert!(store.verify(id).await.unwrap().is_sound());
    assert_eq!(store.calibration("latest").await.unwrap().content, fan.content);
    // And it comes back with it.
    store.import_session(&file).await.unwrap();
    assert_eq!(kept(&head().await), Kept::Here);
}

#[tokio::test]
async fn a_calibration_travels_with_the_session_that_used_it() {
    let here = fresh().await;
    let (source, id, fan) = measured(&here.store).await;
    // Another one, which the session knows nothing of.
    here.store.record_calibration(&super::calibrations::fan(SessionId::fresh())).await.unwrap();
    let file = here.folder.path().join("used.bps");
    here.store.export_session(id, &file).await.unwrap();
    let there = fresh().await;
    there.store.import_session(&file).await.unwrap();
    let all = there.store.calibrations().await.unwrap();
    assert_eq!(all.len(), 1);
    assert_eq!((&all[0].blake3, kept(&all[0])), (&fan.head.blake3, Kept::Elsewhere));
    assert!(there.store.verify(id).await.unwrap().is_sound());
    // The one that it was made from brings it too; what is there stays.
    let raw = here.folder.path().join("raw.bps");
    here.store.export_session(source, &raw).await.unwrap();
    there.store.import_session(&raw).await.unwrap();
    let all = there.store.calibrations().await.unwrap();
    assert_eq!((all.len(), kept(&all[0])), (1, Kept::Here));
}

#[tokio::test]
async fn from_a_pose_back_to_the_raw_session() {
    let Fresh { store, folder: _folder } = fresh().await;
    let (source, id, _) = measured(&store).await;
    let back: Vec<String> = sqlx::query_scalar(
        "SELECT DISTINCT s.session FROM v_poses p
         JOIN v_inputs i ON i.processing = p.processing
         JOIN v_calibration_sources s ON s.calibration = i.calibration
         WHERE p.session = ? AND s.session IS NOT NULL",
    )
    .bind(id.to_string())
    .fetch_all(&store.readers)
    .await
    .unwrap();
    assert_eq!(back, [source.to_string()]);
}

#[tokio::test]
async fn a_foreign_calibration_that_is_not_what_it_says_does_not_come_in() {
    for (statement, expected) in [
        ("UPDATE calibrations SET content_text = 'x'", "its BLAKE3 is"),
        ("UPDATE calibrations SET name = 'a' || char(27) || '[2J'", "name has control characters"),
        (
            "UPDATE calibration_sources SET made_from = printf('%.*c', 36, '.') WHERE place = 1",
            "a session's id is damaged",
        ),
        (
            "UPDATE input_files SET blake3 = printf('%.*c', 64, '0')",
            "calibrations has rows of no session",
        ),
    ] {
        let here = fresh().await;
        let (_, id, _) = measured(&here.store).await;
        let file = here.folder.path().join("used.bps");
        here.store.export_session(id, &file).await.unwrap();
        let mut other = super::opening::stranger(&file).await;
        sqlx::query(statement).execute(&mut other).await.unwrap();
        sqlx::Connection::close(other).await.unwrap();
        let there = fresh().await;
        let error = there.store.import_session(&file).await.unwrap_err().to_string();
        assert!(error.contains(expected), "{statement}: {error}");
        assert_eq!(there.store.calibrations().await.unwrap(), []);
    }
}

#[tokio::test]
async fn a_full_session_is_exported_with_its_calibration() {
    let Fresh { store, folder } = fresh().await;
    let id = full_session(&store).await;
    let file = folder.path().join("full.bps");
    store.export_session(id, &file).await.unwrap();
    let there = fresh().await;
    there.store.import_session(&file).await.unwrap();
    let all = there.store.calibrations().await.unwrap();
    assert_eq!(all, [fan(id).head]);
}
