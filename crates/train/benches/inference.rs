//! Time of one patch through the net, in `spindoe` and in burn; one thread.

use std::hint::black_box;

use burn::tensor::{Device, Tensor, TensorData};
use criterion::{Criterion, criterion_group, criterion_main};
use spindoe::vision::net::Weights;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::network::{Activations, Network};
use spindoe::vision::patch::{Patch, SIZE};
use spindoe_train::model::{Net, floats};

fn inference(c: &mut Criterion) {
    let Ok(weights) = Weights::built_in(Head::Dots) else {
        return;
    };
    let device = Device::flex();
    let (Ok(network), Ok(net)) = (
        Network::new(Head::Dots, &weights.layers),
        Net::new(Head::Dots, &weights.layers, &device),
    ) else {
        return;
    };
    let mut group = c.benchmark_group("a patch of 64 x 64");
    let (patch, mut activations) = (Patch::default(), Activations::new(Head::Dots));
    group.bench_function("spindoe", |b| {
        b.iter(|| network.forward(black_box(&patch), &mut activations)[0]);
    });
    for batch in [1, 32] {
        group.bench_function(format!("burn, batch of {batch}"), |b| {
            b.iter(|| {
                let data = TensorData::new(patch.values().repeat(batch), [batch, 1, SIZE, SIZE]);
                floats(net.forward(Tensor::from_data(data, &device)))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, inference);
criterion_main!(benches);
