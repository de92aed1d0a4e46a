"""Traces as MCAP, read by the package that Foxglove writes for Python."""

import base64
import json
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

PROGRAM = Path(sys.executable).with_name("vamaro-swarm")
GHOSTS = ["/scene/ghosts/hears", "/scene/ghosts/sees"]
TOPICS = ["/estimates", "/links", "/metrics", "/scene", *GHOSTS, "/scene/links", "/tf"]


def spawn(path, episodes):
    words = ["spawn", "--task", "hear-see", "--p", "0.5", "--seed", "3", "--in-process", "--episodes", str(episodes)]
    return subprocess.Popen([PROGRAM, *words, "--record", path], stdout=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    assert spawn(path, 2).wait(60) == 0
    return path


def test_a_file_has_an_index_and_all_that_it_says(trace):
    with trace.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        channels = {channel.topic: channel for channel in summary.channels.values()}
        assert sorted(channels) == TOPICS
        assert {topic for topic, channel in channels.items() if channel.message_encoding != "json"} == {"/tf"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema", "protobuf"}
        assert summary.statistics.attachment_count == 2 and summary.statistics.metadata_count == 1
        counts = summary.statistics.channel_message_counts
        states, steps = 2 * 26, 2 * 25
        assert counts[channels["/scene"].id] == counts[channels["/tf"].id] == counts[channels["/metrics"].id] == states
        assert counts[channels["/links"].id] == counts[channels["/estimates"].id] == steps
        # Simulated time: a tenth of a second from one tick to the next, one tick between the episodes.
        times = [message.log_time for _, _, message in reader.iter_messages(["/scene"])]
        assert times == [100_000_000 * tick for tick in range(states)]


def test_messages_are_what_their_schemas_say(trace):
    with trace.open("rb") as file:
        seen = 0
        for schema, channel, message in make_reader(file).iter_messages():
            seen += 1
            if channel.topic == "/tf":
                continue
            value = json.loads(message.data)
            jsonschema.validate(value, json.loads(schema.data))
            for entity in value.get("entities", []):
                assert entity["timestamp"] == {"sec": message.log_time // 10**9, "nsec": message.log_time % 10**9}
        assert seen == 2 * (26 * 3 + 25 * 5)


def test_agents_are_frames_where_they_are_in_the_scene(trace):
    with trace.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        frames = [message for *_, message in reader.iter_decoded_messages(["/tf"])]
        scenes = [json.loads(message.data) for *_, message in reader.iter_messages(["/scene"])]
        for frame, scene in zip(frames, scenes, strict=True):
            assert [one.child_frame_id for one in frame.transforms] == ["hears", "sees"]
            for one, sphere in zip(frame.transforms, scene["entities"][0]["spheres"], strict=True):
                at = sphere["pose"]["position"]
                assert [one.translation.x, one.translation.y] == pytest.approx([at["x"], at["y"]], rel=1e-6)
                assert (one.parent_frame_id, one.rotation.w) == ("world", 1)
        assert frames[13].transforms[0].timestamp.nanos == 300_000_000


def test_the_numbers_are_those_of_the_run(trace):
    with trace.open("rb") as file:
        reader = make_reader(file)
        header = json.loads(next(iter(reader.iter_metadata())).metadata["header"])
        assert (header["task"], header["seed"], header["n_agents"]) == ("hear-see", 3, 2)
        metrics = [json.loads(message.data) for _, _, message in reader.iter_messages(["/metrics"])]
        listed = subprocess.run([PROGRAM, "inspect", trace, "--json"], capture_output=True, text=True, check=True)
        returns = [episode["return"] for episode in json.loads(listed.stdout)["episodes"]]
        assert [metrics[25]["return"], metrics[51]["return"]] == pytest.approx(returns, abs=1e-9)
        assert metrics[0]["delivery"] == 1 and "reward" not in metrics[0]
        links = [json.loads(message.data) for _, _, message in reader.iter_messages(["/links"])]
        for step, told in enumerate(links):
            heard = [told["receivers"][agent]["arrived"][1 - agent] == 0 for agent in (0, 1)]
            assert metrics[step + step // 25]["delivery"] == sum(heard) / 2
        attachments = list(reader.iter_attachments())
        assert [attachment.name for attachment in attachments] == ["episode 0", "episode 1"]
        assert base64.b64encode(attachments[0].data[:4]) == b"GQAAAA==", "25 steps"


def test_what_a_killed_run_leaves_is_whole_up_to_its_last_chunk(tmp_path):
    path = tmp_path / "killed.mcap"
    with spawn(path, 1_000_000) as run:
        deadline = time.monotonic() + 60
        while not (path.exists() and path.stat().st_size > 300_000) and time.monotonic() < deadline:
            time.sleep(0.001)
        run.send_signal(signal.SIGKILL)
    seen = {"Message": 0, "Attachment": 0}
    with path.open("rb") as file, pytest.raises((EndOfFile, struct.error)):
        for record in StreamReader(file, validate_crcs=True).records:
            name = type(record).__name__
            seen[name] = seen.get(name, 0) + 1
    assert seen["Attachment"] > 1 and "Footer" not in seen
    # Before the attachment of an episode stand all its messages, and behind it perhaps those of the next.
    episode = 26 * 3 + 25 * 5
    assert seen["Message"] // episode in (seen["Attachment"], seen["Attachment"] + 1)
