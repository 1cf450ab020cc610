//! A webcam has no simulator of ours: the kernel has one, `vivid`, and `.ci/vivid` boots a kernel
//! that has it.

use crate::sim::{Hosted, Simulated};
use crate::transport::Address;

struct Vivid;

pub(super) fn simulate(_: &[Simulated]) -> Result<Box<dyn Hosted>, String> {
    Ok(Box::new(Vivid))
}

impl Hosted for Vivid {
    fn address(&self, _: &str) -> Option<Address> {
        None
    }

    fn lose_next(&self) {}

    fn lacks(&self) -> Option<String> {
        Some("it needs a kernel with the module vivid; `bash .ci/vivid` boots one".to_owned())
    }
}
