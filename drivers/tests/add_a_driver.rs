//! The example of `docs/add-a-driver.md`: its files are compiled here as they stand there, and tried
//! as every driver is.

// What the example finds at the root of the drivers' crate.
use beampose_drivers::{
    Connected, Driver, Moved, OptionSpec, Role, Setting, Simulator, Value, conformance, sim,
    transport,
};

mod acme_t100;

#[test]
fn the_example_conforms() {
    let failed = conformance::failures(&acme_t100::SENSOR);
    assert!(failed.is_empty(), "\n{}", failed.join("\n"));
}

#[test]
fn the_page_shows_the_example_as_it_is() {
    let page = include_str!("../../docs/add-a-driver.md");
    for (name, text) in [
        ("protocol.rs", include_str!("acme_t100/protocol.rs")),
        ("driver.rs", include_str!("acme_t100/driver.rs")),
        ("sim.rs", include_str!("acme_t100/sim.rs")),
        ("mod.rs", include_str!("acme_t100/mod.rs")),
    ] {
        let block = format!("`drivers/acme_t100/{name}`\n\n```rust\n{text}```\n");
        assert!(
            page.contains(&block),
            "{name} is another in docs/add-a-driver.md; it should be:\n{block}"
        );
    }
}
