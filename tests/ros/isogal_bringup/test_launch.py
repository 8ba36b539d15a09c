"""The launch file, run with stand-ins for the launch packages, which the wheels do not have."""

import json
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml

from helpers.domains import claim_domain
from helpers.launching import BRINGUP, Launch
from helpers.packages import executables
from helpers.player import Player
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.domain import DOMAIN
from isogal_ros.graph.plan import node_class
from isogal_ros.graph.running import shared_memory, sweep_shared_memory
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.parameters.values import parameter_file

FILE = BRINGUP / "launch" / "isogal.launch.py"
SHORT = "route.duration=600 gravity.field=normal"
"""Keys of a scenario whose map is made at once."""


@pytest.fixture
def launch(monkeypatch, tmp_path):
    """Describes a launch of the file with arguments."""

    def go(**arguments: str) -> Launch:
        given = {"set": SHORT, "bag": str(tmp_path / "bag")} | arguments
        made = Launch(FILE, given, tmp_path, monkeypatch)
        made.describe()
        return made

    return go


def test_every_node_is_started_with_parameters_it_knows(launch) -> None:
    """And has the topics of drivers."""
    rules = "/sbg/imu:=imu/data_raw /usbl:=position/usbl/fix"
    made = launch(remap=rules)
    assert set(made.nodes) == {*topics.NODES, RECORDER}
    for name, keys in made.nodes.items():
        assert keys["package"] == ("isogal_ros" if name == RECORDER else name)
        assert keys["executable"] == name
        assert name in executables()[keys["package"]]
        assert keys["remappings"] == [
            ("imu/data_raw", "/sbg/imu"),
            ("position/usbl/fix", "/usbl"),
        ]
        known = node_class(name).settings_model.model_fields
        file, own = keys["parameters"]
        assert file == str(BRINGUP / "params" / "isogal.yaml")
        assert set(own) <= {*known, "use_sim_time", "route.duration", "gravity.field"}, name
        assert own["use_sim_time"] is (name != topics.INS_SIM)
        assert keys["respawn"] is False
    assert all(text for _, text in made.declared.values())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rate": "abc"}, "rate: must be a number, not 'abc'"),
        ({"params": "/no/such/file.yaml"}, "params: /no/such/file.yaml: cannot be read"),
        ({"params": "LIST"}, "must map names of nodes"),
        ({"bag": "EXISTS"}, "EXISTS'"),
        ({"bag": ""}, "bag: must name a new folder, not ''"),
        ({"bag": "/proc/x"}, "bag: /proc/x: cannot be written: /proc: "),
        ({"checkpoint": "/proc/x"}, "checkpoint: /proc/x: cannot be written: /proc: "),
        ({"set": "map.source=/no/such.nc"}, "/no/such.nc"),
        ({"namespace": "a b"}, "namespace: must be words"),
        ({"set": "route.speed"}, "set: must be NAME=VALUE, not 'route.speed'"),
        ({"set": "route.sped=3"}, "did you mean 'route.speed'"),
        ({"set": "route.speed='3"}, "set: No closing quotation"),
        ({"remap": "/imu:=imu/data"}, "did you mean 'imu/data_raw'"),
    ],
)
def test_arguments_are_checked_before_any_node(launch, tmp_path, arguments, words) -> None:
    """`rate:=abc` once left four orphans, a missing file the default scenario."""
    (tmp_path / "EXISTS").mkdir()
    (tmp_path / "LIST").write_text("[1, 2]")
    given = {
        key: str(tmp_path / text) if text.isupper() else text for key, text in arguments.items()
    }
    with pytest.raises(InputError, match=words):
        launch(**given)


def test_an_argument_that_is_none_is_named(launch, monkeypatch) -> None:
    launch_file = ["/bin/ros2", "launch", "isogal_bringup", "isogal.launch.py"]
    for words, said in (
        (["raet:=5.0"], "unknown key 'raet', did you mean 'rate'?"),
        (["rate:=5.0", "xyzzy:=1"], "unknown key 'xyzzy'; allowed: params, "),
    ):
        monkeypatch.setattr(sys, "argv", [*launch_file, *words])
        with pytest.raises(InputError, match=re.escape(f"isogal.launch.py: {said}")):
            launch()
    # where another file includes it, the arguments are the other's
    monkeypatch.setattr(sys, "argv", ["/bin/ros2", "launch", "ship", "ship.launch.py", *words])
    assert launch().nodes


@pytest.mark.parametrize(
    ("section", "parameters", "words"),
    [
        ("/**/ukf_fusion_node", {"publsh_tf": False}, "did you mean 'publish_tf'"),
        ("ins_sim_node", {"rate": -1.0}, "ins_sim_node: rate"),
        ("/**/isogal_recorder", {"compres": True}, "isogal_recorder: unknown parameter 'compres'"),
        ("/*", {"route": {"sped": 3.0}}, "route.sped"),
        ("/**/pmht_mm_node", {"map": {"source": "/no/such.nc"}}, "/no/such.nc"),
        ("/**", {"publish_tf": False}, "unknown parameter 'publish_tf'"),
        ("/ukf_fusion_node", {"truth": {"imu": {"grad": "quantum"}}}, "truth.imu.grad"),
    ],
)
def test_what_one_node_would_refuse_ends_the_launch_before_any(
    launch, tmp_path, section, parameters, words
) -> None:
    document = {section: {"ros__parameters": parameters}}
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match=re.escape(words)):
        launch(params=str(tmp_path / "params.yaml"))


def test_a_section_for_nobody_is_said(launch, tmp_path, capsys) -> None:
    """What it asks for once went unheard, as a node does not look at another's section."""
    names = ("/**", "ukf_fuson_node", "/ship/ukf_fusion_node", "ukf_fusion_node", "/camera")
    document = {name: {"ros__parameters": {}} for name in names}
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(document))
    words = {"params": str(tmp_path / "params.yaml")}
    launch(**words)
    said = [line.rpartition("section ")[2] for line in capsys.readouterr().err.splitlines()]
    nobody = "is for no node of the graph"
    assert sorted(said[1:]) == [
        f"/camera {nobody}",
        f"/ship/ukf_fusion_node {nobody}; did you mean '/ukf_fusion_node'?",
        f"ukf_fuson_node {nobody}; did you mean '/ukf_fusion_node'?",
    ]
    launch(**words, namespace="ship")
    err = capsys.readouterr().err
    assert f"section ukf_fusion_node {nobody}; did you mean '/ship/ukf_fusion_node'?" in err
    assert f"section /ship/ukf_fusion_node {nobody}" not in err


@pytest.mark.parametrize("respawn", ["false", "true"])
def test_whose_end_ends_all(launch, respawn) -> None:
    """One that fails while all end fails the launch."""
    made = launch(respawn=respawn)
    for code, fails in ((0, 0), (130, 0), (-15, 0), (1, 1), (-9, 1)):
        made.exit_code = 0
        reason = made.reason_of(RECORDER, code, ending=True)
        assert (made.exit_code, reason is None) == (fails, not fails), code
    for name, keys in made.nodes.items():
        reasons, failed = {}, []
        for code in (0, 1, -9):
            made.exit_code = 0
            reasons[code] = made.reason_of(name, code)
            failed += [code] * made.exit_code
        assert failed == ([1, -9] if respawn == "false" else [1])
        arrived = "the simulated vehicle has arrived"
        died = {code: f"{name} has ended with code {code}" for code in reasons}
        lives_on = {} if respawn == "false" else {0: None, -9: None}
        arrival = {0: arrived} if name == topics.INS_SIM else {}
        assert reasons == died | lives_on | arrival
        assert keys["respawn"] is (respawn == "true")


def test_arguments_for_a_real_vehicle(launch) -> None:
    made = launch(
        vehicle="real",
        namespace="ship",
        log_level="warn",
        set=f"{SHORT} route.height=0.0 matcher.name=tercom 'route.start=[-37.9, 144.6]'",
    )
    assert set(made.nodes) == {*topics.NODES, RECORDER} - {topics.INS_SIM}
    for name, keys in made.nodes.items():
        own = keys["parameters"][1]
        assert keys["namespace"] == "ship"
        assert keys["ros_arguments"] == ["--log-level", "warn"]
        assert own["use_sim_time"] is False
        assert own["route.start"] == [-37.9, 144.6]
        assert ("matcher.name" in own) is ("matcher" in node_class(name).sections)
        assert topics.INS_SIM not in own.get("peers", ())
    assert made.nodes[topics.GRAVIMETER]["parameters"][1]["simulate"] is False
    played = launch(vehicle="real", use_sim_time="true").nodes[topics.GRAVIMETER]
    assert played["parameters"][1]["use_sim_time"] is True


@pytest.mark.slow
def test_two_graphs_in_one_domain_and_nodes_of_both_are_killed(
    tmp_path_factory, scenario, recording
) -> None:
    """In a domain that the environment names, neither hears anything of the other. The killed
    nodes of one go on until its vehicle has arrived. The other has its form for a real vehicle
    and the sensors of a recording, from a player that stands in for `ros2 bag play --clock`: its
    fixes are the recorded ones, and without respawn the first kill ends all."""
    killed = [topics.UKF_FUSION, RECORDER, topics.INS_SIM]
    # long enough that it has not arrived before all are killed, however long they take to start
    keys = {"ship": ("route.duration=180.0",), "boat": ()}
    more = {
        "ship": {"rate": "15.0", "respawn": "true", "run": "1"},
        "boat": {"vehicle": "real", "use_sim_time": "true"},
    }
    before, made = shared_memory(), {}
    try:
        with pytest.MonkeyPatch.context() as patch, claim_domain() as domain:
            patch.setenv(DOMAIN, str(domain))
            for name, words in more.items():
                folder = tmp_path_factory.mktemp(name)
                file = folder / "params.yaml"
                file.write_text(parameter_file(scenario(*keys[name]), {}))
                words |= {"params": str(file), "bag": str(folder / "bag"), "namespace": name}
                made[name] = Launch(FILE, words, folder, patch)
                made[name].describe()
            with ThreadPoolExecutor(1) as pool:
                running = pool.submit(made["ship"].run, when="fix with", kill=list(killed))
                play(made["boat"], recording, scenario())
                running.result()
    finally:
        for one in made.values():
            one.kill()
        sweep_shared_memory(before)
    ship, boat = heard(made["ship"], "ship"), heard(made["boat"], "boat")
    assert made["ship"].reason == "the simulated vehicle has arrived", made["ship"].output()
    assert (made["ship"].exit_code, {*made["ship"].codes.values()}) == (0, {0})
    assert made["ship"].died[:-1] == [(node, -9) for node in killed], made["ship"].output()
    for words in ("begun", "goes on from the checkpoint", "arrived"):
        assert words in made["ship"].output()
    assert len(BagReader(made["ship"].folder / "bag").files) == 2
    assert len(ship.last_nav) > 100
    assert any(ship.fix_positions().values())
    # without respawn one that dies ends all, in order
    assert made["boat"].reason == "pmht_mm_node has ended with code -9"
    assert made["boat"].exit_code == 1
    assert made["boat"].codes.pop(topics.PMHT_MM) == -9
    assert set(made["boat"].codes.values()) == {0}, made["boat"].output()
    recorded = Collector(scenario())
    recorded.take_bag(BagReader(recording))
    wanted, found = recorded.fix_positions(), boat.fix_positions()
    assert len(wanted) == 6
    assert list(wanted) == list(found)
    for ns, place in wanted.items():
        # rad: 6 cm. The same to the bit but where, without lock-step, a reading comes before the
        # fix of the batch before has reached the filter: 7 mm were seen
        assert found[ns] == pytest.approx(place, abs=1e-8)


def play(made: Launch, recording: Path, scenario: Scenario) -> None:
    """Run the graph of a real vehicle on the sensors of a recording, then kill its matcher."""
    recorded = Collector(scenario)
    recorded.take_bag(BagReader(recording))
    sensors = (topics.CLOCK, topics.IMU, adapter_of(scenario).raw)
    with Player(recording, sensors, "boat") as player:
        made.start()
        player.play(list(recorded.fixes), lambda: made.output().count("]: ready") >= 4)
        made.run_on(kill=[topics.PMHT_MM])


def heard(one: Launch, name: str) -> Collector:
    """What a graph in a namespace has recorded: nothing but itself, and to the end."""
    reader = BagReader(one.folder / "bag")
    assert "Traceback" not in one.output()
    collected = Collector(reader.scenario())
    collected.take_bag(reader)
    assert reader.cut is None
    own = {topic.split("/")[1] for topic in reader.types}
    assert own <= {name, "clock", "diagnostics", "tf", "tf_static"}
    assert {said.source.split("/")[0] for said in collected.said} <= {name}
    return collected


def test_viewer_layouts_show_topics_that_exist() -> None:
    layout = (BRINGUP / "viewer" / "foxglove.json").read_text()
    rviz = yaml.safe_load((BRINGUP / "viewer" / "isogal.rviz").read_text())
    displays = rviz["Visualization Manager"]["Displays"]
    shown = {one["Topic"]["Value"] for one in displays if "Topic" in one}
    shown.update(re.findall(r'"(/[a-z_]+(?:/[a-z_]+)?)[".]', layout))
    assert len(shown) > 8
    assert shown <= {"/" + topic.name.lstrip("/") for topic in topics.ALL}
    panels = json.loads(layout)
    used = set(re.findall(r'"(\w+!\w+)"', json.dumps(panels["layout"])))
    assert used == set(panels["configById"])
