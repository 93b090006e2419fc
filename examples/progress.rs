//! Progress of the search for the photos' depth, which ends after some photos.
//!
//! `cargo run --release --example progress [-- FOLDER [PHOTOS]]`

use std::ops::ControlFlow;

use liveview_synthesizer::{Options, SynthesisError, Synthesizer, Target};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let most: usize = args.get(1).map_or(Ok(usize::MAX), |most| most.parse())?;
    let mut options = Options::default();
    options.scene.width = Some(168);
    let mut synthesizer = Synthesizer::open("tests/scenes/workshop", &options)?;
    synthesizer.photos_mut().on_depth_search(move |next| {
        println!("depth of photo {} of {}: {}", next.done + 1, next.count, next.name);
        if next.done < most { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    match synthesizer.render(&Target::held_out("target_0")) {
        Err(SynthesisError::Cancelled) => println!("cancelled"),
        frame => frame?.picture().save(format!("{}/target_0.png", args.first().map_or(".", |folder| folder)))?,
    }
    Ok(())
}
