//! What the bus itself takes, without another process to wait for: `cargo bench --bench bus`. An observation is
//! published in place and received in place, so nothing but writing it grows with its size.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};

use vamaro_swarm::bus::{
    AgentPort, AgentSharedPort, Header, Kind, Layout, PROTOCOL, Sample, SupervisorPort, SwarmAddress,
    SwarmDirectory,
};

fn observations(c: &mut Criterion) {
    let mut group = c.benchmark_group("observation, published and received by two agents and the supervisor");
    for bytes in [64, 1024, 16384, 65536] {
        let directory = SwarmDirectory::create().expect("room for a swarm");
        let address = SwarmAddress { agents: 2, ..SwarmAddress::of(directory.tag()) };
        let layout =
            Layout { agents: 2, observation: bytes / 4, action: 1, joint: 1, logits: 1, relay: false };
        let supervisor = SupervisorPort::create(&address, &layout).expect("services");
        let mut ports =
            [0, 1].map(|agent| AgentSharedPort::open(&address, &layout, agent, 0).expect("ports"));
        let header = Header {
            protocol: PROTOCOL,
            kind: Kind::Observation as u32,
            swarm: address.id(),
            worlds: 1,
            length: layout.observation as u64,
            ..Header::default()
        };
        group.bench_with_input(BenchmarkId::from_parameter(bytes), &bytes, |bencher, _| {
            bencher.iter(|| {
                ports[0].publish_observation(header, |words| words[0] = 1).expect("a free sample");
                for port in &mut ports {
                    let sample = port.receive_observation().expect("a port").expect("it was published");
                    black_box(sample.words()[0]);
                }
                black_box(supervisor.receive_observation().expect("a port").is_some())
            })
        });
    }
}

criterion_group!(benches, observations);
criterion_main!(benches);
