//! Writes the laboratory's three full-size pictures at one place of the rail, and prints the truth:
//! `cargo run --release -p beampose-virtual-lab --example pictures -- FOLDER [RAIL_MM] [SEED]`.

use std::error::Error;

use beampose_core::Emission;
use beampose_virtual_lab::{World, WorldConfig};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = std::path::PathBuf::from(arguments.next().ok_or("which folder?")?);
    let rail_mm: f64 = arguments.next().map_or(Ok(0.0), |text| text.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    std::fs::create_dir_all(&folder)?;
    let world = World::new(WorldConfig::laboratory(), seed)?;
    let module = world.module_state(rail_mm, 0.0, 658.0, Emission::On);
    for name in world.config().cameras.keys() {
        std::fs::write(folder.join(format!("{name}.jpg")), world.render_jpeg(name, &module, 0)?)?;
        println!(
            "{name}: {} dots, {} targets",
            world.imaged_dots(name, &module)?.len(),
            world.imaged_targets(name)?.len()
        );
    }
    println!("position {:?} mm", module.position.as_slice());
    println!("world_from_module {}", module.world_from_module);
    Ok(())
}
