//! Work that blocks, done on a thread of its own while a virtual clock stands still.

use beampose_core::{Clock, InstrumentError};
use futures::channel::oneshot;

/// Does `work` on a thread of its own and waits for it, so that several instruments are at work at
/// once although one thread drives them all.
///
/// # Errors
/// What `work` says; [`InstrumentError::Disconnected`] where no thread could be had.
pub(crate) async fn aside<T: Send + 'static>(
    clock: &dyn Clock,
    name: &str,
    work: impl FnOnce() -> Result<T, InstrumentError> + Send + 'static,
) -> Result<T, InstrumentError> {
    let (done, result) = oneshot::channel();
    let _time_stands_still = clock.external();
    let none = |why: String| InstrumentError::Disconnected(format!("no thread for {name}: {why}"));
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(move || {
            // Whoever asked may have gone.
            let _ = done.send(work());
        })
        .map_err(|error| none(error.to_string()))?;
    result.await.map_err(|_| none("it ended early".to_owned()))?
}
