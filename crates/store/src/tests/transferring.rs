//! A session as one file, out and in; and files that somebody else made.

use beampose_core::SessionId;
use sqlx::{AssertSqlSafe, Connection as _};

use super::keeping::full_session;
use super::opening::stranger;
use super::{Fresh, fresh, session};
use crate::{Store, StoreError, truth};

/// A file with a full session, from a database that has others too.
async fn exported() -> (Fresh, SessionId, std::path::PathBuf) {
    let fresh = fresh().await;
    session(&fresh.store).await;
    let id = full_session(&fresh.store).await;
    full_session(&fresh.store).await;
    let file = fresh.folder.path().join("a session's file.bps");
    fresh.store.export_session(id, &file).await.unwrap();
    (fresh, id, file)
}

#[tokio::test]
async fn an_imported_session_is_the_one_that_was_exported() {
    let (here, id, file) = exported().await;
    let there = fresh().await;
    full_session(&there.store).await;
    let (a, b) = (&here.store, &there.store);
    let imported = b.import_session(&file).await.unwrap();
    assert_eq!(imported.session, id);
    // `wall`, its own, and that of the earlier attempt.
    assert_eq!(imported.pictures, 3);

    let mut header = a.session(id).await.unwrap();
    header.header.origin_json = None;
    assert_eq!(b.session(id).await.unwrap(), header);
    assert_eq!(b.steps(id).await.unwrap(), a.steps(id).await.unwrap());
    assert_eq!(b.captures(id).await.unwrap(), a.captures(id).await.unwrap());
    assert_eq!(b.readings(id).await.unwrap(), a.readings(id).await.unwrap());
    assert_eq!(b.events(id).await.unwrap(), a.events(id).await.unwrap());
    assert_eq!(b.gaps(id).await.unwrap(), a.gaps(id).await.unwrap());
    assert_eq!(b.attempts(id).await.unwrap(), a.attempts(id).await.unwrap());
    assert_eq!(b.tags(id).await.unwrap(), a.tags(id).await.unwrap());
    assert_eq!(b.notes(id).await.unwrap(), a.notes(id).await.unwrap());
    let truths = (truth::captures(a, id).await.unwrap(), truth::parameters(a, id).await.unwrap());
    assert_eq!(truth::captures(b, id).await.unwrap(), truths.0);
    assert_eq!(truth::parameters(b, id).await.unwrap(), truths.1);
    same_processings(a, b, id).await;
    assert_eq!(b.verify(id).await.unwrap().problems, Vec::<String>::new());
}

/// The same processings under other numbers.
async fn same_processings(a: &Store, b: &Store, id: SessionId) {
    let of_a = a.processings(id).await.unwrap();
    let of_b = b.processings(id).await.unwrap();
    assert_eq!((of_a.len(), of_b.len()), (2, 2));
    for (a_one, b_one) in of_a.iter().zip(&of_b) {
        assert_eq!((&a_one.start, a_one.finished), (&b_one.start, b_one.finished));
        assert_eq!(a.poses(a_one.id).await.unwrap(), b.poses(b_one.id).await.unwrap());
        let capture = super::p000();
        let solutions = [
            a.solution(a_one.id, &capture).await.unwrap(),
            b.solution(b_one.id, &capture).await.unwrap(),
        ];
        assert_eq!(solutions[0], solutions[1]);
        let results = [a.results(a_one.id).await.unwrap(), b.results(b_one.id).await.unwrap()];
        assert_eq!(results[0][0].result_json, results[1][0].result_json);
    }
}

#[tokio::test]
async fn the_same_session_gives_the_same_bytes_wherever_it_has_been() {
    let (here, id, file) = exported().await;
    let again = here.folder.path().join("again.bps");
    here.store.export_session(id, &again).await.unwrap();
    let bytes = std::fs::read(&file).unwrap();
    assert!(bytes == std::fs::read(&again).unwrap(), "exported twice");
    let there = fresh().await;
    full_session(&there.store).await;
    there.store.import_session(&file).await.unwrap();
    let back = there.folder.path().join("back.bps");
    there.store.export_session(id, &back).await.unwrap();
    assert!(bytes == std::fs::read(&back).unwrap(), "imported and exported");
    let mut left: Vec<_> = std::fs::read_dir(here.folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.starts_with("beampose.db"))
        .collect();
    left.sort();
    assert_eq!(left, ["a session's file.bps", "again.bps"], "nothing is left beside it");
}

#[tokio::test]
async fn a_session_file_is_a_database_of_its_own() {
    let (_here, id, file) = exported().await;
    let store = Store::open(&file).await.unwrap();
    assert_eq!(store.sessions().await.unwrap().len(), 1);
    assert!(store.verify(id).await.unwrap().is_sound());
    assert_eq!(store.session(id).await.unwrap().header.origin_json, None);
}

#[tokio::test]
async fn import_never_touches_a_stored_session() {
    let (here, id, file) = exported().await;
    here.store.tag(id, "later", jiff::Timestamp::UNIX_EPOCH).await.unwrap();
    let error = here.store.import_session(&file).await.unwrap_err();
    assert!(matches!(error, StoreError::Refused { .. }), "{error}");
    assert!(error.to_string().ends_with("is stored already, and stays as it is"), "{error}");
    assert_eq!(here.store.tags(id).await.unwrap(), ["later", "warm"]);
    // Deleted first, it comes back.
    here.store.delete_session(id).await.unwrap();
    here.store.import_session(&file).await.unwrap();
    assert_eq!(here.store.tags(id).await.unwrap(), ["warm"]);
    assert!(here.store.verify(id).await.unwrap().is_sound());
}

#[tokio::test]
async fn export_never_replaces_a_file() {
    let (here, id, file) = exported().await;
    let before = std::fs::read(&file).unwrap();
    let error = here.store.export_session(id, &file).await.unwrap_err();
    assert!(error.to_string().ends_with("the file is there already"), "{error}");
    assert!(before == std::fs::read(&file).unwrap());
    let nowhere = here.folder.path().join("no/such/folder.bps");
    let error = here.store.export_session(id, &nowhere).await.unwrap_err();
    assert!(matches!(error, StoreError::NotWritable { .. }), "{error}");
}

/// What import says of the file after `statements`; nothing may have come in.
async fn refused_after(statements: &[&str]) -> String {
    let (_here, _, file) = exported().await;
    let mut other = stranger(&file).await;
    sqlx::query("PRAGMA foreign_keys = OFF").execute(&mut other).await.unwrap();
    for statement in statements {
        sqlx::query(AssertSqlSafe(*statement)).execute(&mut other).await.unwrap();
    }
    other.close().await.unwrap();
    refused(&file).await
}

async fn refused(file: &std::path::Path) -> String {
    let there = fresh().await;
    let error = there.store.import_session(file).await.unwrap_err();
    assert!(there.store.sessions().await.unwrap().is_empty());
    let blobs: i64 = sqlx::query_scalar("SELECT count(*) FROM blobs")
        .fetch_one(&there.store.readers)
        .await
        .unwrap();
    assert_eq!(blobs, 0);
    error.to_string().replace(&file.display().to_string(), "FILE")
}

#[track_caller]
fn says(told: &str, expected: &str) {
    assert!(told.contains(expected), "{told}\nis not: {expected}");
}

#[tokio::test]
async fn a_file_with_a_schema_of_its_own_is_refused_before_anything_of_it_is_used() {
    let other = "its tables are not those of a session file";
    for statement in [
        "CREATE TRIGGER evil AFTER INSERT ON sessions BEGIN DELETE FROM blobs; END",
        "CREATE VIEW evil AS SELECT load_extension('evil')",
        "DROP VIEW v_poses",
        "CREATE TABLE more (id INTEGER)",
        "CREATE VIRTUAL TABLE words USING fts5(word)",
        "CREATE INDEX evil ON sessions (hex(title))",
        "ALTER TABLE notes ADD COLUMN more TEXT CHECK (length(hex(zeroblob(100000000))) > 0)",
    ] {
        says(&refused_after(&[statement]).await, other);
    }
    // The same name, another meaning.
    let replaced = ["DROP VIEW v_captures", "CREATE VIEW v_captures AS SELECT 1 AS session"];
    says(&refused_after(&replaced).await, other);
    let forged = [
        "PRAGMA writable_schema = ON",
        "UPDATE sqlite_schema SET sql = replace(sql, 'STRICT', '') WHERE name = 'notes'",
    ];
    says(&refused_after(&forged).await, other);
}

#[tokio::test]
async fn a_file_that_is_something_else_is_named_for_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "Rail test of Tuesday.\n").unwrap();
    says(&refused(&file).await, "it is a file of another kind");
    says(&refused(folder.path()).await, "it is a folder");
    says(&refused(&folder.path().join("missing")).await, "FILE cannot be opened: ");
    let photos = folder.path().join("photos.db");
    let mut other = stranger(&photos).await;
    sqlx::query("CREATE TABLE photos (id INTEGER)").execute(&mut other).await.unwrap();
    other.close().await.unwrap();
    says(&refused(&photos).await, "it is the SQLite database of another program");
    let newer = [
        "CREATE TABLE later (session TEXT)",
        "INSERT INTO _sqlx_migrations VALUES (99, 'future', '2030-01-01', 1, x'00', 0)",
    ];
    says(&refused_after(&newer).await, "was made by a newer beampose (schema 99");
    let none = fresh().await;
    let path = none.store.path().to_owned();
    none.store.close().await;
    says(&refused(&path).await, "it has no session");
    let two = fresh().await;
    session(&two.store).await;
    session(&two.store).await;
    says(&refused(two.store.path()).await, "a program has it open");
    let path = two.store.path().to_owned();
    two.store.close().await;
    says(&refused(&path).await, "it has several sessions");
}

#[tokio::test]
async fn a_file_whose_content_breaks_a_rule_is_refused_whole() {
    for (statement, expected) in [
        ("UPDATE blobs SET bytes = x'00' WHERE id = 1", "is damaged: its BLAKE3 is"),
        (
            "DELETE FROM blobs WHERE CAST(bytes AS TEXT) = 'wall'",
            "its rows refer to what is not there",
        ),
        ("DELETE FROM processings", "its rows refer to what is not there"),
        ("UPDATE sessions SET title = 'a' || char(27) || '[2J'", "title has control characters"),
        ("UPDATE notes SET note = 'a' || char(0) || 'b'", "note has control characters"),
        ("UPDATE notes SET note = printf('%.*c', 64000001, 'x')", "a text of more than 64000000"),
        ("UPDATE blobs SET bytes = zeroblob(200000001) WHERE id = 1", "a picture has more than"),
        (
            "UPDATE tags SET session = '0195a000-0000-7000-8000-000000000001'",
            "refer to what is not",
        ),
        ("UPDATE sessions SET number = 9223372036854775807", "row numbers out of range"),
        ("UPDATE results SET id = -1 WHERE id = 1", "results has row numbers out of range"),
    ] {
        let told = refused_after(&[statement]).await;
        says(&told, expected);
    }
}

#[tokio::test]
async fn a_session_whose_id_is_a_path_is_refused() {
    let path = "../../../../../../../../../../etc/pw";
    assert_eq!(path.len(), 36);
    let (_here, _, file) = exported().await;
    let mut other = stranger(&file).await;
    sqlx::query("PRAGMA foreign_keys = OFF").execute(&mut other).await.unwrap();
    for table in crate::tables::session_tables(&mut other, "main").await.unwrap() {
        let column = if table.name == "sessions" { "id" } else { "session" };
        if table.columns.iter().any(|it| it.name == column) {
            let sql = format!("UPDATE {} SET {column} = ?", table.name);
            sqlx::query(AssertSqlSafe(sql)).bind(path).execute(&mut other).await.unwrap();
        }
    }
    other.close().await.unwrap();
    says(&refused(&file).await, "a session's id is damaged");
}

#[tokio::test]
async fn a_value_that_the_files_own_rules_would_forbid_does_not_come_in() {
    // Rules of the file can be switched off by who makes it; ours hold here.
    let told = refused_after(&[
        "PRAGMA ignore_check_constraints = ON",
        "UPDATE poses SET status = 'excellent'",
    ])
    .await;
    says(&told, "FILE");
    let told = refused_after(&[
        "PRAGMA ignore_check_constraints = ON",
        "UPDATE captures SET setpoints_json = '{'",
    ])
    .await;
    says(&told, "FILE");
}

#[tokio::test]
async fn a_file_with_a_flipped_byte_is_refused_or_comes_in_as_a_sound_database() {
    let (here, id, file) = exported().await;
    let bytes = std::fs::read(&file).unwrap();
    let hurt = here.folder.path().join("hurt.bps");
    let again = here.folder.path().join("again.bps");
    let (mut refused, mut harmless) = (0, 0);
    // Most of a small file is free space: a flip there is harmless.
    for at in (0..bytes.len()).step_by(3001) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x41;
        std::fs::write(&hurt, &flipped).unwrap();
        let there = fresh().await;
        match there.store.import_session(&hurt).await {
            Err(_) => {
                assert!(there.store.sessions().await.unwrap().is_empty());
                refused += 1;
            }
            Ok(_) => {
                let found = there.store.verify_file().await.unwrap();
                assert_eq!(found, Vec::<String>::new(), "byte {at}");
                there.store.export_session(id, &again).await.unwrap();
                std::fs::remove_file(&again).unwrap();
                harmless += 1;
            }
        }
    }
    println!("{refused} refused, {harmless} came in");
    assert!(refused > 0 && harmless > 0);
}

#[tokio::test]
async fn a_file_of_an_older_schema_comes_in_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let id = SessionId::fresh();
    let hash = blake3::hash(b"wall").to_hex();
    for version in 1..crate::open::newest_schema() {
        let file = folder.path().join(format!("schema {version}.bps"));
        let mut old = stranger(&file).await;
        crate::open::migrate_to(&mut old, version).await.unwrap();
        let times = "'2026-03-01T08:00:00Z', 1.5, '2026-03-01T08:00:01Z', 2.5";
        for statement in [
            format!(
                "INSERT INTO sessions (id, title, experiment, plan_text, rig_text,
                    measurement_json, plan_hash, software, steps, opened_utc, opened_s, closed_utc,
                    closed_s, outcome)
                 VALUES ('{id}', 'old', 'translation', '', '', '{{}}', '00', '0.1', 1, {times},
                    'completed')"
            ),
            format!(
                "INSERT INTO steps (session, number, label, kind, started_utc, started_s,
                    finished_utc, finished_s, outcome)
                 VALUES ('{id}', 1, 'capture p000', 'capture', {times}, 'done')"
            ),
            format!(
                "INSERT INTO captures VALUES ('{id}', 'p000', 1, '{{}}', '{{}}',
                    '2026-03-01T08:00:00Z', 1.5)"
            ),
            format!("INSERT INTO blobs (blake3, bytes) VALUES ('{hash}', CAST('wall' AS BLOB))"),
            format!("INSERT INTO pictures VALUES ('{id}', 'p000', 'cam_a', '{hash}', 4, {times})"),
            format!(
                "INSERT INTO readings (id, session, step, instrument, quantity, value, at_utc, at_s)
                 VALUES (7, '{id}', 1, 'wavemeter', 'wavelength', 658.1, '2026-03-01T08:00:00Z', 1.5),
                    (8, '{id}', 1, 'thermometer', 'temperature', 24.5, '2026-03-01T08:00:00Z', 1.6)"
            ),
        ] {
            sqlx::query(AssertSqlSafe(statement)).execute(&mut old).await.unwrap();
        }
        old.close().await.unwrap();
        let there = fresh().await;
        let read = there.store.import_session(&file).await.unwrap();
        assert_eq!((read.session, read.rows, read.pictures), (id, 6, 1), "schema {version}");
        let readings = there.store.readings(id).await.unwrap();
        let values: Vec<f64> = readings.iter().map(|stored| stored.reading.value).collect();
        assert_eq!(values, [658.1, 24.5], "schema {version}");
        assert_eq!(there.store.verify(id).await.unwrap().problems, Vec::<String>::new());
    }
}
