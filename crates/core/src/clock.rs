//! Time, only ever through the [`Clock`] trait: real in the laboratory, virtual in simulation.
//!
//! In virtual time a wait takes none. [`VirtualClock::drive`] runs one future and whatever it
//! joins; whenever all of it waits for timers alone, the clock jumps to the earliest of them. Work
//! done by other threads (the store, a renderer) is bracketed by [`Clock::external`], and while it
//! is under way the clock stands still. So time stamps are consistent and the same in every run.

use std::collections::BTreeMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// A point in time: UTC for people, and the monotonic offset from the clock's start for sums.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Stamp {
    /// Offset from the clock's start; never goes back.
    pub monotonic: Duration,
    /// RFC 3339 UTC.
    pub utc: jiff::Timestamp,
}

/// A future that a trait object can return.
pub type BoxFuture<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// The time, and waiting for it.
pub trait Clock: Send + Sync {
    /// Now.
    fn now(&self) -> Stamp;
    /// Ready `duration` from now.
    fn sleep(&self, duration: Duration) -> BoxFuture<'_, ()>;
    /// Says that something outside this clock is being waited for, until the guard is dropped.
    fn external(&self) -> ExternalGuard;
}

/// While it lives, a virtual clock stands still.
#[derive(Debug, Default)]
pub struct ExternalGuard(Option<Arc<AtomicUsize>>);

impl Drop for ExternalGuard {
    fn drop(&mut self) {
        if let Some(count) = &self.0 {
            count.fetch_sub(1, Ordering::SeqCst);
        }
    }
}

/// Ends `future` with `Err` if it is not done within `deadline` of the clock.
///
/// # Errors
/// The deadline, when it passed first.
pub async fn within<T>(
    clock: &dyn Clock,
    deadline: Duration,
    future: impl Future<Output = T>,
) -> Result<T, Duration> {
    let future = std::pin::pin!(future);
    match futures::future::select(future, clock.sleep(deadline)).await {
        futures::future::Either::Left((value, _)) => Ok(value),
        futures::future::Either::Right(((), _)) => Err(deadline),
    }
}

/// Time that passes only when everybody waits for it.
#[derive(Debug, Clone)]
pub struct VirtualClock(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    start: jiff::Timestamp,
    timers: Mutex<Timers>,
    external: Arc<AtomicUsize>,
}

#[derive(Debug, Default)]
struct Timers {
    now: Duration,
    next_id: u64,
    /// Keyed by due time, then by order of creation: equal times wake in the order they were set.
    waiting: BTreeMap<(Duration, u64), Waker>,
}

impl VirtualClock {
    /// A clock that shows `start` and stands still until driven.
    #[must_use]
    pub fn starting_at(start: jiff::Timestamp) -> Self {
        Self(Arc::new(Shared { start, timers: Mutex::default(), external: Arc::default() }))
    }

    /// A clock that shows `start + offset` and counts from `offset` on: the clock of a session that
    /// began at `start` and goes on.
    #[must_use]
    pub fn resumed(start: jiff::Timestamp, offset: Duration) -> Self {
        let clock = Self::starting_at(start);
        clock.timers().now = offset;
        clock
    }

    /// Runs `future` to its end, in virtual time.
    pub fn drive<'a, T: Send + 'a>(&self, future: BoxFuture<'a, T>) -> BoxFuture<'a, T> {
        Box::pin(Drive { clock: self.clone(), future })
    }

    fn timers(&self) -> MutexGuard<'_, Timers> {
        self.0.timers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Jumps to the earliest timer, if there is one, and wakes it.
    fn advance(&self) -> bool {
        let waker = {
            let mut timers = self.timers();
            let Some(((due, _), waker)) = timers.waiting.pop_first() else {
                return false;
            };
            timers.now = timers.now.max(due);
            waker
        };
        waker.wake();
        true
    }
}

impl Clock for VirtualClock {
    fn now(&self) -> Stamp {
        let monotonic = self.timers().now;
        let offset = jiff::SignedDuration::try_from(monotonic).unwrap_or(jiff::SignedDuration::MAX);
        let utc = self.0.start.checked_add(offset).unwrap_or(jiff::Timestamp::MAX);
        Stamp { monotonic, utc }
    }

    fn sleep(&self, duration: Duration) -> BoxFuture<'_, ()> {
        let mut timers = self.timers();
        let due = timers.now.saturating_add(duration);
        let id = timers.next_id;
        timers.next_id += 1;
        Box::pin(Timer { clock: self.clone(), key: (due, id) })
    }

    fn external(&self) -> ExternalGuard {
        self.0.external.fetch_add(1, Ordering::SeqCst);
        ExternalGuard(Some(self.0.external.clone()))
    }
}

struct Timer {
    clock: VirtualClock,
    key: (Duration, u64),
}

impl Future for Timer {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let mut timers = self.clock.timers();
        if timers.now >= self.key.0 {
            return Poll::Ready(());
        }
        timers.waiting.insert(self.key, cx.waker().clone());
        Poll::Pending
    }
}

impl Drop for Timer {
    fn drop(&mut self) {
        self.clock.timers().waiting.remove(&self.key);
    }
}

/// Notes whether anything inside woke, and passes the wake on to the outer executor.
struct Noted {
    woken: AtomicBool,
    outer: Waker,
}

impl Wake for Noted {
    fn wake(self: Arc<Self>) {
        self.woken.store(true, Ordering::SeqCst);
        self.outer.wake_by_ref();
    }
}

struct Drive<'a, T> {
    clock: VirtualClock,
    future: BoxFuture<'a, T>,
}

impl<T> Future for Drive<'_, T> {
    type Output = T;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<T> {
        let noted = Arc::new(Noted { woken: AtomicBool::new(false), outer: cx.waker().clone() });
        let waker = Waker::from(noted.clone());
        let mut inner = Context::from_waker(&waker);
        loop {
            noted.woken.store(false, Ordering::SeqCst);
            if let Poll::Ready(value) = self.future.as_mut().poll(&mut inner) {
                return Poll::Ready(value);
            }
            if noted.woken.load(Ordering::SeqCst) {
                continue;
            }
            // Somebody outside is at work: their wake polls us again.
            if self.clock.0.external.load(Ordering::SeqCst) > 0 || !self.clock.advance() {
                return Poll::Pending;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock() -> VirtualClock {
        VirtualClock::starting_at(jiff::Timestamp::UNIX_EPOCH)
    }

    #[test]
    fn a_hundred_minutes_of_waiting_take_none() {
        let clock = clock();
        let wait = Box::pin(async { clock.sleep(Duration::from_secs(6000)).await });
        futures_block_on(clock.drive(wait));
        assert_eq!(clock.now().monotonic, Duration::from_secs(6000));
        assert_eq!(clock.now().utc.as_second(), 6000);
    }

    #[test]
    fn parallel_waits_overlap() {
        let clock = clock();
        let wait = Box::pin(async {
            let (a, b) = (clock.sleep(Duration::from_secs(3)), clock.sleep(Duration::from_secs(5)));
            futures::future::join(a, b).await;
        });
        futures_block_on(clock.drive(wait));
        assert_eq!(clock.now().monotonic, Duration::from_secs(5));
    }

    #[test]
    fn a_deadline_passes_only_when_the_work_is_longer() {
        let clock = clock();
        let run = Box::pin(async {
            let quick = within(&clock, Duration::from_secs(2), clock.sleep(Duration::from_secs(1)));
            assert_eq!(quick.await, Ok(()));
            let slow = within(&clock, Duration::from_secs(2), clock.sleep(Duration::from_secs(9)));
            assert_eq!(slow.await, Err(Duration::from_secs(2)));
        });
        futures_block_on(clock.drive(run));
        assert_eq!(clock.now().monotonic, Duration::from_secs(3));
    }

    #[test]
    fn work_of_other_threads_takes_no_virtual_time() {
        let clock = clock();
        let run = Box::pin(async {
            let (send, receive) = futures::channel::oneshot::channel();
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(20));
                let _ = send.send(7);
            });
            let work = async {
                let _guard = clock.external();
                receive.await.unwrap()
            };
            assert_eq!(within(&clock, Duration::from_secs(1), work).await, Ok(7));
        });
        futures_block_on(clock.drive(run));
        assert_eq!(clock.now().monotonic, Duration::ZERO);
    }

    fn futures_block_on<T>(future: impl Future<Output = T>) -> T {
        futures::executor::block_on(future)
    }
}
