//! Opening: what may be at the path, and how the connections are set.

use sqlx::{ConnectOptions, SqliteConnection};

use super::{fresh, session};
use crate::{Store, StoreError, path_of};

async fn pragma(connection: &mut SqliteConnection, sql: &'static str) -> String {
    let as_text: Result<String, _> = sqlx::query_scalar(sql).fetch_one(&mut *connection).await;
    match as_text {
        Ok(text) => text,
        Err(_) => {
            let number: i64 = sqlx::query_scalar(sql).fetch_one(connection).await.unwrap();
            number.to_string()
        }
    }
}

#[tokio::test]
async fn the_writer_is_durable_and_keeps_the_rules() {
    let fresh = fresh().await;
    let mut reader = fresh.store.readers.acquire().await.unwrap();
    let writer = &mut *fresh.store.writer.turn("look").await.unwrap();
    assert_eq!(pragma(writer, "PRAGMA journal_mode").await, "wal");
    assert_eq!(pragma(writer, "PRAGMA synchronous").await, "2", "FULL");
    assert_eq!(pragma(writer, "PRAGMA foreign_keys").await, "1");
    assert_eq!(pragma(writer, "PRAGMA busy_timeout").await, "10000");
    assert_eq!(pragma(&mut reader, "PRAGMA busy_timeout").await, "10000");
}

#[tokio::test]
async fn readers_cannot_write() {
    let fresh = fresh().await;
    let written = sqlx::query("DELETE FROM sessions").execute(&fresh.store.readers).await;
    assert!(written.unwrap_err().to_string().contains("readonly"));
}

#[tokio::test]
async fn opening_again_migrates_nothing_and_loses_nothing() {
    let fresh = fresh().await;
    let id = session(&fresh.store).await;
    let path = fresh.store.path().to_owned();
    fresh.store.close().await;
    for _ in 0..2 {
        let again = Store::open(&path).await.unwrap();
        assert_eq!(again.sessions().await.unwrap()[0].id, id);
        let mut connection = again.writer.turn("look").await.unwrap();
        let applied = pragma(&mut connection, "SELECT count(*) FROM _sqlx_migrations").await;
        assert_eq!(applied, crate::open::newest_schema().to_string());
        drop(connection);
        again.close().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_file_opened_by_many_at_once_is_migrated_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("beampose.db");
    let opening: Vec<_> = (0..8)
        .map(|_| {
            let path = path.clone();
            tokio::spawn(async move { Store::open(&path).await })
        })
        .collect();
    for one in opening {
        one.await.unwrap().unwrap();
    }
}

#[tokio::test]
async fn what_was_not_closed_is_there_when_it_is_opened_again() {
    let fresh = fresh().await;
    let id = session(&fresh.store).await;
    // Neither closed nor dropped: as a program that was killed leaves it.
    let copy = fresh.folder.path().join("copy.db");
    for ending in ["", "-wal"] {
        let name = |path: &std::path::Path| format!("{}{ending}", path.display());
        std::fs::copy(name(fresh.store.path()), name(&copy)).unwrap();
    }
    let reopened = Store::open(&copy).await.unwrap();
    assert_eq!(reopened.captures(id).await.unwrap().len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn run_and_pipeline_write_side_by_side_from_any_thread() {
    let fresh = fresh().await;
    let writing: Vec<_> = (0..8)
        .map(|_| {
            let store = fresh.store.clone();
            tokio::spawn(async move {
                let id = session(&store).await;
                crate::truth::save_parameters(&store, id, "{}").await.unwrap();
                let processing = super::solving::solve(&store, id).await;
                assert_eq!(store.poses(processing).await.unwrap().len(), 2);
                assert_eq!(store.captures(id).await.unwrap().len(), 2);
                assert!(store.verify(id).await.unwrap().is_sound());
                store.find_session(&id.to_string()).await.unwrap();
            })
        })
        .collect();
    for one in writing {
        one.await.unwrap();
    }
    assert_eq!(fresh.store.sessions().await.unwrap().len(), 8);
}

#[track_caller]
fn text(opened: Result<Store, StoreError>, folder: &tempfile::TempDir) -> String {
    let text = opened.unwrap_err().to_string();
    text.replace(&folder.path().display().to_string(), "FOLDER")
}

#[tokio::test]
async fn what_is_no_database_is_named_for_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let in_folder = |name: &str| folder.path().join(name);
    let opened = Store::open(folder.path()).await;
    let expected = "FOLDER is a folder: name a file in it, as in FOLDER/beampose.db";
    assert_eq!(text(opened, &folder), expected);

    std::fs::write(in_folder("notes.txt"), "Rail test of Tuesday.\n").unwrap();
    let opened = Store::open(&in_folder("notes.txt")).await;
    let expected = "FOLDER/notes.txt is not a beampose database: it is a file of another kind";
    assert_eq!(text(opened, &folder), expected);
    let untouched = std::fs::read_to_string(in_folder("notes.txt")).unwrap();
    assert_eq!(untouched, "Rail test of Tuesday.\n");

    let opened = Store::open(&in_folder("no/such/beampose.db")).await;
    let expected = "FOLDER/no/such/beampose.db cannot be made: \
                    the folder FOLDER/no/such does not exist";
    assert_eq!(text(opened, &folder), expected);

    let mut damaged = b"SQLite format 3\0".to_vec();
    damaged.extend([7; 4096]);
    std::fs::write(in_folder("damaged.db"), damaged).unwrap();
    let opened = Store::open(&in_folder("damaged.db")).await;
    assert!(text(opened, &folder).starts_with("FOLDER/damaged.db is not a beampose database"));
}

#[tokio::test]
async fn an_empty_file_becomes_a_database() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.db");
    std::fs::write(&path, "").unwrap();
    assert!(Store::open(&path).await.unwrap().sessions().await.unwrap().is_empty());
}

/// A connection to `path` that knows nothing of beampose.
pub(super) async fn stranger(path: &std::path::Path) -> SqliteConnection {
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(path).create_if_missing(true);
    options.connect().await.unwrap()
}

#[tokio::test]
async fn the_database_of_another_program_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photos.db");
    let mut other = stranger(&path).await;
    sqlx::query("CREATE TABLE photos (id INTEGER)").execute(&mut other).await.unwrap();
    let before = std::fs::read(&path).unwrap();
    let opened = Store::open(&path).await;
    assert!(text(opened, &folder).ends_with("it is the SQLite database of another program"));
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

#[tokio::test]
async fn a_newer_schema_asks_for_an_update() {
    let fresh = fresh().await;
    let newer = "INSERT INTO _sqlx_migrations VALUES (99, 'future', '2030-01-01', 1, x'00', 0)";
    sqlx::query(newer).execute(&mut *fresh.store.writer.turn("test").await.unwrap()).await.unwrap();
    let error = Store::open(fresh.store.path()).await.unwrap_err();
    let StoreError::NewerSchema { version: 99, known, .. } = error else { panic!("{error}") };
    assert_eq!(known, crate::open::newest_schema());
}

#[tokio::test]
async fn a_database_that_another_program_holds_is_busy() {
    let fresh = fresh().await;
    let mut other = stranger(fresh.store.path()).await;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    sqlx::query("PRAGMA busy_timeout = 1")
        .execute(&mut *fresh.store.writer.turn("test").await.unwrap())
        .await
        .unwrap();
    let error = crate::writer::begin(&fresh.store.writer, "store a step").await.err().unwrap();
    assert!(matches!(error, StoreError::Busy { .. }), "{error}");
}

#[tokio::test]
async fn a_transaction_that_is_given_up_holds_nobody_up_and_leaves_nothing() {
    let fresh = fresh().await;
    let store = &fresh.store;
    let mut write = crate::writer::begin(&store.writer, "test").await.unwrap();
    sqlx::query("PRAGMA user_version = 7").execute(&mut *write).await.unwrap();
    drop(write);
    // Another program's turn comes without ours beginning anything.
    let mut other = stranger(store.path()).await;
    sqlx::query("PRAGMA busy_timeout = 5000").execute(&mut other).await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    sqlx::query("COMMIT").execute(&mut other).await.unwrap();
    let mut writer = store.writer.turn("look").await.unwrap();
    assert_eq!(pragma(&mut writer, "PRAGMA user_version").await, "0");
}

#[test]
fn a_database_url_means_its_path() {
    for (text, path) in [
        ("beampose.db", "beampose.db"),
        ("sqlite:beampose.db", "beampose.db"),
        ("sqlite:///data/beampose.db?mode=rwc", "/data/beampose.db"),
        ("sqlite://data/beampose.db", "data/beampose.db"),
    ] {
        assert_eq!(path_of(text), std::path::Path::new(path));
    }
}
