//! Displays and the solving pipeline look on and cannot disturb.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use beampose_core::SessionOutcome;

use super::fakes::*;
use crate::{Notice, Observer, Observers};

/// Sends the name of each notice.
struct Names(Sender<&'static str>);

impl Observer for Names {
    fn notice(&mut self, notice: &Notice) {
        let name = match notice {
            Notice::Opened(_) => "opened",
            Notice::StepStarted(_) => "started",
            Notice::Event(_)
            | Notice::Paused { .. }
            | Notice::Continued
            | Notice::ByHand { .. } => return,
            Notice::StepDone(record) => {
                assert!(record.capture.is_none(), "pictures do not go to displays");
                "done"
            }
            Notice::Captured(_) => "captured",
            Notice::Closed(_) => "closed",
        };
        let _ = self.0.send(name);
    }
}

/// Panics at the first notice.
struct Clumsy;

impl Observer for Clumsy {
    fn notice(&mut self, _: &Notice) {
        panic!("a display fails");
    }
}

/// Takes no second notice until it is let go.
struct Stuck(Receiver<()>);

impl Observer for Stuck {
    fn notice(&mut self, _: &Notice) {
        let _ = self.0.recv();
    }
}

#[test]
fn a_display_hears_of_everything_in_order() {
    let (names, heard) = channel();
    let mut lab = Lab::new();
    lab.observers = Observers::none().display(Names(names));
    lab.outcome(&plan([capture("p000")], [rail(0.0)]));
    let observers = std::mem::take(&mut lab.observers);
    assert_eq!(observers.finish(Duration::from_secs(10)), 0);
    let heard: Vec<_> = heard.iter().collect();
    let expected = ["opened", "started", "done", "captured", "started", "done", "closed"];
    assert_eq!(heard, expected);
}

#[test]
fn a_display_that_fails_or_hangs_neither_delays_nor_ends_the_run() {
    let (let_go, stuck) = channel();
    let mut lab = Lab::new();
    lab.observers = Observers::none().display(Clumsy).display(Stuck(stuck));
    let many = std::iter::repeat_n(wait(1.0), 700);
    assert_eq!(lab.outcome(&plan(many, [])), SessionOutcome::Completed);
    drop(let_go);
    let observers = std::mem::take(&mut lab.observers);
    assert!(observers.finish(Duration::from_secs(10)) > 0, "notices missed are counted");
}

#[test]
fn the_pipeline_gets_each_capture_once_it_is_stored() {
    let (pictures, solved) = channel();
    let mut lab = Lab::new();
    let log = lab.log.clone();
    lab.observers = Observers::none().on_capture(move |capture| {
        log.write(format!("solving {}", capture.id));
        let _ = pictures.send(capture);
    });
    lab.outcome(&plan([capture("p000"), capture("p001")], []));
    assert_eq!(lab.log.place("solving p000"), lab.log.place("stored 1") + 1);
    let first = solved.recv().unwrap();
    assert_eq!(first.pictures[1].bytes, b"cam_b");
}

#[test]
fn a_pipeline_that_fails_does_not_end_the_run() {
    let mut lab = Lab::new();
    lab.observers = Observers::none().on_capture(|_| panic!("the pipeline is gone"));
    let steps = plan([capture("p000"), capture("p001")], []);
    assert_eq!(lab.outcome(&steps), SessionOutcome::Completed);
    assert_eq!(lab.stored(), [1, 2]);
}
