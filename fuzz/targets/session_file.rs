//! A session from elsewhere: taken whole or refused, and never more than its own rows.

#![no_main]

use beampose_store::Store;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let (Ok(folder), Ok(runtime)) =
        (tempfile::tempdir(), tokio::runtime::Builder::new_current_thread().enable_all().build())
    else {
        return;
    };
    let file = folder.path().join("session.beampose");
    if std::fs::write(&file, bytes).is_err() {
        return;
    }
    runtime.block_on(async {
        let Ok(store) = Store::open(&folder.path().join("own.db")).await else { return };
        let imported = store.import_session(&file).await;
        let sessions = store.sessions().await.unwrap_or_default();
        assert_eq!(sessions.len(), usize::from(imported.is_ok()));
        store.close().await;
    });
});
