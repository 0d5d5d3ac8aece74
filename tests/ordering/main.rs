//! The ordering rule: right in every order that the queues can take, and no wait or barrier too many.

#[path = "../common/mod.rs"]
mod common;
mod model;
mod rig;

use common::{LAVAPIPE, ORDERS, SWIFTSHADER, Setup};
use lasray::gpu::{Edge, Gpu};
use rig::{Access, Rig};

/// What shows that an edge is missing, on devices that run in order (the software drivers): stale data
/// in an order of the two-queues layer, or synchronization validation, or the model alone.
#[derive(Debug, PartialEq)]
enum Seen {
    Stale { order: &'static str },
    Validation,
    ModelOnly,
}

fn seen_by(edge: Edge) -> Seen {
    match edge {
        Edge::CopyAfterUse | Edge::TableReuse | Edge::HostRead => Seen::Stale { order: "late0" },
        Edge::BuildAfterCopy | Edge::RingReuse => Seen::Stale { order: "late1" },
        // One queue runs its work in order, so the data is right; validation sees the accesses of shaders
        // through storage buffers.
        Edge::BuildAfterEarlier
        | Edge::BuildPass
        | Edge::FrameAfterEarlier
        | Edge::FrameAfterReadback
        | Edge::FramePass
        | Edge::ReadbackAfterPass => Seen::Validation,
        // Software drivers write host memory, and validation does not follow the host's reads.
        Edge::HostAfterReadback => Seen::ModelOnly,
    }
}

fn rig(gpu: &Gpu, access: Access, without: Option<Edge>) -> Rig {
    Rig::new(gpu, access, without).unwrap()
}

fn runs_right(setup: Setup) {
    for access in [Access::Address, Access::StorageBuffer] {
        let gpu = setup.gpu();
        assert!(gpu.has_transfer_queue() || setup.queue_order().is_none());
        assert_eq!(rig(&gpu, access, None).run().unwrap(), [true; 4], "{access:?}");
        assert_eq!(gpu.messages(), [""; 0], "{access:?}");
        assert_eq!(gpu.allocated_bytes(), 0, "all buffers are given back");
    }
}

#[test]
fn the_queues_of_the_driver_give_right_data() {
    common::run("the_queues_of_the_driver_give_right_data", LAVAPIPE, runs_right);
}

#[test]
fn swiftshader_gives_right_data() {
    common::run("swiftshader_gives_right_data", SWIFTSHADER, runs_right);
}

#[test]
fn two_queues_give_right_data_in_every_order() {
    for setup in ORDERS {
        common::run("two_queues_give_right_data_in_every_order", setup, runs_right);
    }
}

#[test]
fn the_model_finds_every_access_ordered_and_every_edge_needed() {
    for setup in [LAVAPIPE, ORDERS[0]] {
        common::run("the_model_finds_every_access_ordered_and_every_edge_needed", setup, |setup| {
            let gpu = setup.gpu();
            for access in [Access::Address, Access::StorageBuffer] {
                let mut whole = rig(&gpu, access, None);
                whole.run().unwrap();
                assert_eq!(model::hazards(&whole.steps()), [""; 0], "{access:?}");
            }
            for edge in Edge::ALL {
                let mut lacking = rig(&gpu, Access::Address, Some(edge));
                lacking.run().unwrap();
                assert!(!model::hazards(&lacking.steps()).is_empty(), "{edge:?} is not needed");
            }
        });
    }
}

#[test]
fn a_missing_edge_between_queues_or_to_the_host_gives_stale_data() {
    let test = "a_missing_edge_between_queues_or_to_the_host_gives_stale_data";
    for setup in ORDERS {
        common::run(test, setup, |setup| {
            for edge in Edge::ALL {
                if seen_by(edge) == (Seen::Stale { order: setup.two_queues.unwrap() }) {
                    let right = rig(&setup.gpu(), Access::Address, Some(edge)).run().unwrap();
                    assert!(right.contains(&false), "without {edge:?} the data was right");
                }
            }
        });
    }
}

#[test]
fn a_missing_barrier_is_reported_by_synchronization_validation() {
    let test = "a_missing_barrier_is_reported_by_synchronization_validation";
    if !common::layer_sees_queues(test) {
        return;
    }
    for setup in [LAVAPIPE, ORDERS[0]] {
        common::run(test, setup, |setup| {
            for edge in Edge::ALL {
                // On one queue the waits for copies and their readers are barriers, too.
                let between_queues = matches!(edge, Edge::CopyAfterUse | Edge::BuildAfterCopy);
                if seen_by(edge) == Seen::Validation || between_queues {
                    let gpu = setup.gpu();
                    rig(&gpu, Access::StorageBuffer, Some(edge)).run().unwrap();
                    let messages = gpu.messages();
                    assert!(
                        messages.iter().any(|m| m.contains("SYNC-HAZARD")),
                        "without {edge:?}: {messages:?}"
                    );
                }
            }
        });
    }
}
