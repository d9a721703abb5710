//! burn's forward pass and that of `spindoe` give the same cells.
#![allow(clippy::unwrap_used)]

use burn::tensor::{Device, Tensor, TensorData};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::synth::SynthConfig;
use spindoe::vision::net::Weights;
use spindoe::vision::net::graph::Head;
use spindoe::vision::net::network::{Activations, Network};
use spindoe::vision::net::weights::Layer;
use spindoe::vision::patch::SIZE;
use spindoe_train::model::{Net, floats};
use spindoe_train::sample::{Sample, random_frame, sample};

fn samples(count: u64) -> Vec<Sample> {
    (0..count)
        .map(|k| {
            let mut rng = ChaCha8Rng::seed_from_u64(1_000 + k);
            let frame = random_frame(&SynthConfig::default(), &mut rng).unwrap();
            sample(&frame, &mut rng)
        })
        .collect()
}

/// The largest difference of any cell.
fn difference(head: Head, layers: &[Layer], samples: &[Sample]) -> f32 {
    let device = Device::flex();
    let net = Net::new(head, layers, &device).unwrap();
    let network = Network::new(head, layers).unwrap();
    let mut activations = Activations::new(head);
    let mut worst = 0f32;
    for sample in samples {
        let data = TensorData::new(sample.patch.values().to_vec(), [1, 1, SIZE, SIZE]);
        let expected = floats(net.forward(Tensor::from_data(data, &device))).unwrap();
        let found = network.forward(&sample.patch, &mut activations);
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(&expected) {
            worst = worst.max((a - b).abs());
        }
    }
    worst
}

#[test]
fn both_give_the_same_cells() {
    let samples = samples(12);
    for head in Head::ALL {
        let weights = Weights::built_in(head).unwrap();
        let built_in = difference(head, &weights.layers, &samples);
        assert!(built_in < 1e-4, "{head:?}: {built_in:.1e}");
        for seed in 0..3 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let layers = Net::random_layers(head, &mut rng).unwrap();
            let random = difference(head, &layers, &samples[..3]);
            assert!(random < 1e-4, "{head:?}: {random:.1e}");
        }
        println!("{head:?}, built-in weights: cells differ by at most {built_in:.1e}");
    }
}
