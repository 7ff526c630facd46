"""Experiment files: values read, and the message for each kind of mistake."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.experiment.describe import described_keys
from softprint.runtime.experiment.renamed import KEYS, VALUES
from softprint.runtime.experiment.schema.scene import KinematicSpec
from softprint.runtime.experiment.stored_text import contact_table

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples").glob("*.toml"))

GOOD = """
[experiment]
name = "toy"
seed = 3
[body]
mesh = "body.vtu"
[body.handles]
points = 4
frames = [{ name = "base", box = [[-1, -1, -1], [1, 1, 0.1]] }]
[body.material]
young = 1e4
poisson = 0.3
[[colliders]]
name = "ball"
shape = "sphere"
radius = 0.1
[dynamics]
gravity = [0, 0, -9.81]
[[scenes]]
name = "press"
role = "record"
duration = 1
kinematic = ["base"]
colliders = [{ name = "ball", keyframes = [
    { time = 0, position = [0, 0, 1] },
    { time = 1, position = [0, 0, 0] },
] }]
springs = [{ handle = 3, stiffness = 2.0, target = [0, 0, 1] }]
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "body.vtu").touch()
    path = tmp_path / "toy.toml"
    path.write_text(GOOD)
    return path


def complaint(path, *overrides) -> str:
    with pytest.raises(SoftprintError) as caught:
        load_experiment(path, overrides)
    return str(caught.value)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_read(path):
    experiment = load_experiment(path)
    assert experiment.name == path.stem
    # One that trains nothing plays its scenes with what another has learned. Without colliders there are states alone;
    # those of random forces are not recorded.
    learns = {"record"} if experiment.training.models or not experiment.sampled_colliders else set()
    learns -= {"record"} if experiment.sampling.record_with == "forces" else set()
    assert {scene.role for scene in experiment.scenes} == {"test"} | learns
    assert set(experiment.sampled_colliders) <= set(experiment.collider_names)


def test_values_and_defaults(file):
    experiment = load_experiment(file)
    assert (experiment.dim, experiment.seed, experiment.base_dir) == (3, 3, file.parent)
    assert experiment.dynamics.time_step == pytest.approx(1 / 60)
    assert experiment.sampling.collider == experiment.training.collider == "ball"
    assert experiment.collider("ball").shape == "sphere"
    assert [scene.name for scene in experiment.scenes_of_role("record")] == ["press"]
    with pytest.raises(ValueError, match="frozen"):
        experiment.body.material.young = 5.0


def test_overrides_are_toml_and_are_kept_in_the_text(file):
    overrides = [
        "experiment.seed=11",
        "colliders.ball.radius = 0.2",
        'sampling.collider = "ball"',
        "scenes[0].colliders.0.keyframes.1.position=[1, 2, 3]",
    ]
    experiment = load_experiment(file, overrides)
    assert experiment.seed == 11
    assert experiment.collider("ball").radius == 0.2
    assert experiment.scenes[0].colliders[0].keyframes[1].position == (1.0, 2.0, 3.0)
    assert experiment.text.startswith(GOOD)
    assert "# --set experiment.seed=11" in experiment.text


def test_a_byte_order_mark_is_no_mistake(file):
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_experiment(file).text == GOOD


def test_a_comment_is_no_override(file):
    """What a file was made from is read from the text that it keeps."""
    file.write_text(GOOD + "\n# --set contact.stiffness=1e5 makes it softer\n")
    kept = load_experiment(file, ["contact.friction=0.2"])
    table = contact_table(kept.text, file)
    assert (table.stiffness, table.friction) == (kept.contact.stiffness, 0.2)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("body.material.yuong=1", ["[body.material.yuong]", "not a known key", "`young`"]),
        ("bodi.mesh='x'", ["[bodi]", "not a known key", "`body`"]),
        ("colliders.ball.radios=1", ["[colliders[0].radios]", "`radius`"]),
        (
            "body.material.poisson=0.5",
            ["[body.material.poisson]", "less than 0.5", "(got 0.5)", "between -1 and 0.5"],
        ),
        ("body.material.young='stiff'", ["[body.material.young]", "valid number", '(got "stiff")', "[Pa]"]),
        ("body.material.young=true", ["[body.material.young]", "valid number"]),
        ("dynamics.time_step=0", ["[dynamics.time_step]", "greater than or equal to 0.00001"]),
        ("dynamics.time_step=10.0", ["[dynamics.time_step]", "less than or equal to 1"]),
        ("dynamics.time_step=1e-300", ["[dynamics.time_step]", "greater than or equal to 0.00001"]),
        ("body.material.young=1e-170", ["[body.material.young]", "greater than or equal to 0.001"]),
        ("scenes[0].duration=1e300", ["[scenes[0].duration]", "less than or equal to 10000"]),
        ("scenes[0].colliders.0.keyframes.1.position=[1e300, 0, 0]", ["position", "less than or equal to 1000000"]),
        ("sampling.region=[[0, 0, 0]]", ["[sampling.region]", "has too few entries", "(got [[0, 0, 0]])"]),
        ("body.handles.frames.base.box=[[]]", ["[body.handles.frames[0].box"]),
        ("dynamics.time_step=inf", ["[dynamics.time_step]", "finite"]),
        ("experiment.seed=-1", ["[experiment.seed]", "(got -1)"]),
        ("sampling.places=2.5", ["[sampling.places]", "valid integer"]),
        ("sampling.solver.residual=-1.0", ["[sampling.solver.residual]"]),
        ("body.material.model='rubber'", ["[body.material.model]", "'stable_neo_hookean'", '(got "rubber")']),
        ("colliders.ball.shape='bal'", ["[colliders[0].shape]", "known shapes", "sphere"]),
        (
            "body.mesh='gone.vtu'",
            ["[body.mesh]", "does not exist", "gone.vtu", "relative to the experiment file"],
        ),
        ("sampling.disturbance=0.02", ["[sampling]", "disturbed", "leave it out"]),
        (
            "training.models=[{name='one', form='thesis6', learned=false, components=3}]",
            ["[training.models[0]]", 'form = "thesis6" has no components, learned'],
        ),
        ("training.models=[{name='one', fade='proportional'}]", ['form = "force" has no fade']),
        ("dynamics.gravity=[0, -9.81]", ["dynamics.gravity has 2", "2D", "[scenes[0].springs[0].target]"]),
        ("body.handles.frames.base.box=[[0, 0, 0], [1, 1, 0]]", ["[body.handles.frames[0].box]", "is empty"]),
        ("sampling.region=[[0, 0, 0], [1, 1, 0]]", ["[sampling.region]", "is empty"]),
        ("body.handles.frames.base.radius=0.1", ["[body.handles.frames[0]]", "go together"]),
        (
            "body.handles.frames.base.segments=[[[0, 0, 0], [1, 1, 0]]]",
            ["[body.handles.frames[0]]", "either `box`"],
        ),
        (
            "body.handles.frames=[{name='base', segments=[[[0, 0], [1, 1]]], radius=0.1}]",
            ["[body.handles.frames[0].segments[0]]", "2 entries"],
        ),
        (
            "scenes.press.tracking={file='gone.csv', stiffness=1.0, rotation_stiffness=1.0}",
            ["[scenes[0].tracking.file]", "does not exist"],
        ),
        (
            "scenes.press.tracking={file='toy.toml', stiffness=1.0, rotation_stiffness=1.0}",
            ["[scenes[0].tracking.file]", "begins with the line frame,time,x,y,z"],
        ),
        ("body.handles.points=[[0, 0]]", ["[body.handles.points[0]]", "2 entries"]),
        ("body.handles.points='many'", ["[body.handles.points]", "integer", "or"]),
        ("sampling.collider='bull'", ["[sampling.collider]", "did you mean 'ball'?"]),
        ("scenes.press.kinematic=['bass']", ["[scenes[0].kinematic[0]]", "did you mean 'base'?"]),
        ("scenes.press.kinematic=[4]", ["[scenes[0].kinematic[0]]", "4 point handles"]),
        ("scenes.press.kinematic=[1.5]", ["[scenes[0].kinematic[0]]", "valid integer", "or", "valid string"]),
        ("scenes.press.kinematic=['base', 'base']", ["[scenes[0].kinematic[1]]", "given twice"]),
        ("scenes.press.kinematic=[{handle='base'}]", ["[scenes[0].kinematic[0].keyframes] is missing"]),
        (
            "scenes.press.kinematic=[{handle='base', keyframe=[]}]",
            ["[scenes[0].kinematic[0].keyframe]", "did you mean `keyframes`?"],
        ),
        (
            "scenes.press.kinematic=[{handle='bass', keyframes=[{time=0, position=[0, 0, 0]}]}]",
            ["[scenes[0].kinematic[0].handle]", "did you mean 'base'?"],
        ),
        (
            "scenes.press.kinematic=[{handle='base', keyframes=[{time=0, position=[0, 0]}]}]",
            ["[scenes[0].kinematic[0].keyframes[0].position]", "2 entries"],
        ),
        (
            "scenes.press.kinematic=[{handle=1, keyframes=[{time=0, position=[0, 0, 0], rotation=[0, 0, 1]}]}]",
            ["[scenes[0].kinematic[0].keyframes[0].rotation]", "has no effect", "only frames"],
        ),
        (
            "contact={refinement=0, reduced_refinement=2}",
            ["[contact.reduced_refinement]", "has no effect", "leave contact.refinement out"],
        ),
        ("scenes.press.springs[0].rotation_stiffness=1.0", ["rotation_stiffness]", "has no effect"]),
        ("scenes.press.springs[0].rotation_stiffness=-1.0", ["rotation_stiffness]", "greater than or equal"]),
        (
            "scenes.press.springs[0]={handle='base', stiffness=1.0, keyframes="
            "[{time=0, position=[0, 0, 0], rotation=[0, 0, 1]}]}",
            ["springs[0].keyframes[0].rotation]", "has no effect", "rotation_stiffness"],
        ),
        ("scenes.press.colliders.ball.name='cube'", ["[scenes[0].colliders[0].name]", "known: ball"]),
        ("scenes.press.springs[0].handle=4", ["springs[0].handle", "4 point handles"]),
        ("scenes.press.springs[0].handle='top'", ["springs[0].handle", "not the name of a frame"]),
        ("scenes.press.role='train'", ["[scenes[0].role]", "'record' or 'test'"]),
        ("scenes.press.colliders.ball.keyframes[1].time=0.0", ["keyframes[1].time", "later than 0 s"]),
        ("scenes.press.colliders.ball.keyframes[0].rotation=1.0", ["keyframes[0].rotation", "three numbers"]),
        ("scenes.press.colliders.ball.keyframes=[]", ["keyframes]", "at least 1"]),
        ("experiment.name='../up'", ["[experiment.name]", "letters"]),
        ("body=3", ["[body]"]),
    ],
)
def test_mistakes_are_named(file, override, words):
    text = complaint(file, override)
    for word in [str(file), *words]:
        assert word in text


def test_handles_are_fixed_by_name_or_moved_by_tables(file):
    led = "{handle = 2, keyframes = [{time = 0, position = [0, 0, 0]}]}"
    kinematic = load_experiment(file, [f"scenes.press.kinematic=['base', 1, {led}]"]).scenes[0].kinematic
    assert kinematic[:2] == ("base", 1)
    assert isinstance(kinematic[2], KinematicSpec)
    assert kinematic[2].keyframes[0].position == (0.0, 0.0, 0.0)


def test_all_mistakes_are_listed(file):
    text = complaint(file, "body.material.young=-1", "dynamics.tolerance=0", "sampling.staets=2")
    assert len(text.splitlines()) == 3


def test_missing_keys_and_tables_are_named(file):
    file.write_text(GOOD.replace("young = 1e4", "").replace("[dynamics]\ngravity = [0, 0, -9.81]", ""))
    text = complaint(file)
    assert "[body.material.young] is missing; Young's modulus [Pa]" in text
    assert "[dynamics] is missing" in text


def test_repeated_names_are_refused(file):
    file.write_text(GOOD + '[[colliders]]\nname = "ball"\nshape = "sphere"\nradius = 1.0\n')
    assert "[colliders[1].name] is used twice" in complaint(file)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("no value", "KEY.SUBKEY=VALUE"),
        ("=3", "KEY.SUBKEY=VALUE"),
        ("sampling.collider=ball", "needs quotes"),
        ("experiment.name.first='x'", "no further keys"),
        ("colliders.cube.radius=1", "(ball)"),
        ("colliders.7.radius=1", "from 0 to 0"),
    ],
)
def test_overrides_of_unknown_keys_are_refused(file, override, words):
    assert words in complaint(file, override)


def test_files_without_an_experiment_are_refused(tmp_path):
    assert "there is no such experiment file" in complaint(tmp_path / "gone.toml")
    assert "cannot be read" in complaint(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text("[experiment\n")
    assert "this is not TOML" in complaint(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    assert "not a text file" in complaint(broken)


def test_every_key_is_described():
    lines = list(described_keys(Experiment))
    keys = [key for key, _, _ in lines]
    assert ("body.material.young", "number, required", "Young's modulus [Pa]") in lines
    assert "scenes[].springs[].keyframes[].position" in keys
    assert "colliders[].parts" in keys  # of a union: colliders again, and not their keys again and again
    shapes = [kind for key, kind, _ in lines if key == "colliders[].shape"]
    assert '"mesh", required' in shapes
    assert not [key for key, kind, _ in lines if kind.startswith("<") or "typing" in kind]


def test_defaults_are_printed_as_toml():
    kinds = {key: kind for key, kind, _ in described_keys(Experiment)}
    assert kinds["training.models[].patch_inputs"] == "true or false, default false"
    assert kinds["training.device"].endswith('default "cpu"')
    assert kinds["body.material.regions[].young"] == "number, optional"
    defaults = [kind.split("default ")[1] for kind in kinds.values() if "default " in kind]
    for default in defaults:
        tomllib.loads(f"key = {default}")


def test_a_library_makes_colliders_of_all_its_shapes(file):
    experiment = load_experiment(file, ["library.size=0.03", "scenes.press.colliders.ball.name='torus'"])
    assert experiment.sampling.collider == experiment.training.collider == "library"
    assert len(experiment.sampled_colliders) == 52
    torus = experiment.collider("torus")
    assert (torus.shape, torus.size, torus.resolution) == ("library", 0.03, 48)
    # A collider of the file goes before a shape of the same name.
    assert experiment.collider("ball").shape == "sphere"
    few = load_experiment(
        file,
        [
            "library={size=0.03, shapes=['gyroid', 'mug']}",
            "sampling={states=2, places=5, test_places=3, rotations=7}",
        ],
    )
    assert few.sampled_colliders == ("gyroid", "mug")
    # Each shape once at its places, in two states; the mug is a testing shape.
    assert few.planned_contacts == 2 * (5 + 3)
    one = load_experiment(file, ["sampling={states=2, places=5, rotations=7}"])
    assert one.planned_contacts == 2 * 5 * 7


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["library.size=0.03", "library.shapes=['torsu']"], ["[library.shapes[0]]", "did you mean 'torus'"]),
        (["colliders.ball.name='any'"], ["[colliders[0].name]", "stands for any collider"]),
        (["library.size=-1.0"], ["[library.size]", "greater than 0"]),
        (["library={size=0.03, shapes=['mug', 'mug']}"], ["[library.shapes[1]]", "twice"]),
        (
            ["library.size=0.03", "colliders=[{name='library', shape='sphere', radius=0.1}]"],
            ["[colliders[0].name]", "all shapes of [library]"],
        ),
        (["sampling.test_places=2"], ["[sampling.test_places]", "[library]"]),
        (["library.size=0.1", "sampling.collider='ball'"], ["[training.collider]", "sampling.collider"]),
        (["training.collider='library'"], ["[training.collider]", "not the name of a collider"]),
        (
            ["library.size=0.1", "training.models=[{name='one', form='thesis5'}]"],
            ["training.models[0].form]", "one collider"],
        ),
    ],
)
def test_a_library_that_does_not_fit_is_refused(file, overrides, words):
    message = complaint(file, *overrides)
    assert all(word in message for word in words), message


def meshes(file, *names):
    """Empty files beside the experiment: what is in them is read when a collider is made."""
    for name in names:
        (file.parent / name).parent.mkdir(exist_ok=True)
        (file.parent / name).touch()


def test_files_of_ones_own_are_shapes_with_a_side(file):
    meshes(file, "own/a.stl", "own/b.obj", "own/c.ply", "own/d.stl", "held/e.stl")
    table = (
        "library={size=0.03, meshes=['own/*'], validation=['own/d.stl'], test=['held/e.stl', 'own/b.obj']}"
    )
    experiment = load_experiment(file, [table, "sampling={states=2, places=5, test_places=3}"])
    assert experiment.sampled_colliders == ("a", "c", "d", "e", "b")
    roles = {name: experiment.library_roles[name] for name in "abcde"}
    assert roles == {"a": "train", "b": "test", "c": "train", "d": "validation", "e": "test"}
    assert experiment.library_roles["torus"] == "test"
    one = experiment.collider("c")
    assert (one.shape, one.file, one.size, one.centre) == ("mesh", Path("own/c.ply"), 0.03, True)
    assert experiment.planned_contacts == 2 * (3 * 5 + 2 * 3)
    both = load_experiment(file, ["library={size=0.03, meshes=['own/a.stl'], shapes=['mug'], unit='mm'}"])
    assert both.sampled_colliders == ("a", "mug")
    assert (both.collider("a").size, both.collider("a").unit) == (None, "mm")


def test_every_fifth_file_is_for_validation_where_none_is_named(file):
    meshes(file, *(f"own/m{number}.stl" for number in range(12)))
    roles = load_experiment(file, ["library={size=0.03, meshes=['own/*.stl']}"]).library_roles
    mine = [roles[f"m{number}"] for number in range(12)]
    assert (mine.count("train"), mine.count("validation"), mine.count("test")) == (10, 2, 0)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("meshes=['own/*.obj']", ["[library.meshes[0]]", "matches no file", "relative to the experiment"]),
        ("meshes=['own/*']", ["[library.meshes[0]]", "notes.txt, which is no mesh", ".stl"]),
        ("meshes=['own/a.stl', 'other/a.stl']", ["[library.meshes[1]]", "own/a.stl", "rename it"]),
        ("meshes=['own/a.stl'], test=['own/mug.ply']", ["[library.test[0]]", "a shape of the library"]),
        ("validation=['own/ball.stl']", ["[library.validation[0]]", "a [[colliders]] table"]),
    ],
)
def test_files_that_do_not_fit_are_refused(file, table, words):
    meshes(file, "own/a.stl", "own/notes.txt", "own/mug.ply", "own/ball.stl", "other/a.stl")
    message = complaint(file, f"library={{size=0.03, {table}}}")
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["contact.model='barrier'"], ["[contact.friction]", "without friction"]),
        (["contact.distance=1e-4"], ["[contact.distance]", "is of a barrier"]),
        (["contact.model='hard'"], ["[contact.model]", "'penalty' or 'barrier'"]),
    ],
)
def test_contact_that_does_not_fit_together_is_refused(file, overrides, words):
    message = complaint(file, *overrides)
    assert all(word in message for word in words), message


def altered(table: tuple[str, ...], name: str, value: str) -> tuple[str, str]:
    """The `--set` for a key of a table, and the key as in error messages; models are a list."""
    if table == ("training", "models"):
        return f"training.models=[{{name='one', {name}={value}}}]", f"training.models[0].{name}"
    key = ".".join((*table, name))
    return f"{key}={value}", key


@pytest.mark.parametrize(
    ("table", "earlier", "present"),
    [(table, *names) for table, keys in KEYS.items() for names in keys.items()],
)
def test_an_earlier_key_gets_an_error_with_its_new_name(file, table, earlier, present):
    change, key = altered(table, earlier, "1")
    assert complaint(file, change) == f"{file}: [{key}] is now called `{present}`; rename it"
    # The new name leads to a key of the schema.
    known = {key.replace("[]", "") for key, _, _ in described_keys(Experiment)}
    assert ".".join((*table, present)) in known
    assert ".".join((*table, earlier)) not in known


@pytest.mark.parametrize(
    ("path", "earlier", "present"),
    [(path, *names) for path, values in VALUES.items() for names in values.items()],
)
def test_an_earlier_value_gets_an_error_with_its_new_name(file, path, earlier, present):
    *table, name = path
    change, key = altered(tuple(table), name, f"'{earlier}'")
    said = complaint(file, change)
    assert said == f'{file}: [{key}] is now called "{present}" (got "{earlier}"); rename it'
    change, _ = altered(tuple(table), name, f"'{present}'")
    load_experiment(file, [change])


def test_every_earlier_name_in_a_file_is_reported(file):
    said = complaint(
        file,
        "training.field.steps=5",
        "training.models=[{name='a', form='loads', loads=10}, {name='b', internal=false}]",
    )
    assert [line.partition("[")[2].partition("] ")[0] for line in said.splitlines()] == [
        "training.field",
        "training.models[0].loads",
        "training.models[1].internal",
        "training.models[0].form",
    ]
