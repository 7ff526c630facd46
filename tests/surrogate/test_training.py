"""Training on a truth file: splits, the exact force metric, determinism, resume, and a field that can be
learned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch.nn.functional import pad

from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.confidence import contact_measures
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.learned.thesis5.model import ContactCentricOptions
from softprint.runtime.learned.thesis6.correction import DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import DirectGeometry
from softprint.runtime.learned.thesis6.descriptors.attenuation import attenuation
from softprint.runtime.learned.thesis6.model import DescriptorModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.truth.truth_file import TruthData, TruthHeader, create_truth, load_truth
from softprint.runtime.truth.truth_schema import TABLES
from softprint.surrogate.checkpoints import Checkpoint, Checkpoints, load_checkpoint, save_checkpoint
from softprint.surrogate.cross_validation import train_crossed, untrained
from softprint.surrogate.data.folds import folds_of
from softprint.surrogate.data.splits import split_by_state
from softprint.surrogate.force import entry
from softprint.surrogate.force.crossed import CrossedForceTask
from softprint.surrogate.force.data import ForceData, read_force_data
from softprint.surrogate.force.loads import on_loads
from softprint.surrogate.force.loss import ForceMetric, quadratic_form
from softprint.surrogate.force.sample_blocks import SampleBlocks
from softprint.surrogate.force.task import ForceTask
from softprint.surrogate.learning_task import HeldOutError
from softprint.surrogate.thesis5.data import PoolSize, load_dataset
from softprint.surrogate.thesis5.task import ContactCentricTask, InputGains
from softprint.surrogate.thesis6.data import Drawing, join_descriptor_data, load_descriptor_data
from softprint.surrogate.thesis6.loss import DescriptorLoss
from softprint.surrogate.thesis6.task import DescriptorTask
from softprint.surrogate.train import TrainingSettings, train

BALL = Sphere(0.02, 2, name="ball")
OPTIONS = ForceModelOptions((12, 12), "silu", 5e-4, 3e-3, 1e9)
FIELD = ContactCentricOptions("local_geometry", True, (24, 24), "silu", "proportional", 5e-4)
DESCRIPTOR = DescriptorModelOptions((24, 24), "elu", 0.02, 8, "all", 5e-4)
STATES, CONTACTS, DEPTHS = 3, 8, 2


@pytest.fixture(scope="module")
def mechanics(jelly2d_body):
    return compute_mechanics(jelly2d_body, 200, condensation=True, gravity=(0.0, -9.81))


@pytest.fixture(scope="module")
def truth_path(jelly2d_body: ReducedBody, mechanics, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A truth file whose field is a smooth function of contact: linear elasticity with contact forces 1.3
    times too large, and some more to the side, and with some spread in the body. Sample 3 failed, and the last of
    contact 5 jumped."""
    body, rng = jelly2d_body, np.random.default_rng(0)
    top = float(body.mesh.points[:, -1].max())
    probe = ContactStateProbe(body, BALL, mechanics, OPTIONS.law, OPTIONS.band)
    correction = ForceCorrection("truth", ForceModel(OPTIONS, 2, body.n_rows), body, BALL, mechanics)
    teacher = correction.model
    teacher.network.head.bias.data[:] = torch.tensor([0.3, 0.05, 0.0, 0.0, 0.1, 0.02, 0.0, 0.0])
    teacher.traction_scale.fill_(50.0)
    static = StaticCorrection(correction, body)
    states, contacts, samples = [], [], []
    for _ in range(STATES):
        rows = body.rest_rows.copy()
        rows[: body.handles.n_points] += 0.001 * rng.standard_normal((body.handles.n_points, 2))
        states.append(rows)
    for contact in range(STATES * CONTACTS):
        state, angle, place = contact % STATES, rng.uniform(0, 6), rng.uniform(-0.03, 0.03)
        contacts.append(state)
        for depth in range(DEPTHS):
            pose = RigidPose.from_rotation_vector([angle], [place, top + 0.018 - 0.002 * depth])
            assert probe.measure(states[state], pose) is not None
            samples.append((contact, depth, pose, static.displacement(states[state], pose)))
    path = tmp_path_factory.mktemp("truth") / "truth.h5"
    count = len(samples)
    status = np.zeros(count)
    status[3] = 1
    flags = np.zeros(count, dtype=bool)
    flags[11] = True
    sizes = {"nodes": body.n_nodes, "rows": body.n_rows, "dim": 2}
    values = {
        "states": (STATES, {"rows": np.array(states), "stable": np.ones(STATES, dtype=bool)}),
        "contacts": (len(contacts), {"state": np.array(contacts), "unit": np.arange(len(contacts))}),
        "samples": (
            count,
            {
                "contact": np.array([sample[0] for sample in samples]),
                "depth_index": np.array([sample[1] for sample in samples]),
                "pose_rotation": np.array([sample[2].rotation for sample in samples]),
                "pose_translation": np.array([sample[2].translation for sample in samples]),
                "displacement": np.array([sample[3] for sample in samples], dtype=np.float32),
                "status": status,
                "min_det_F": np.full(count, 0.5),
                "branch_flag": flags,
            },
        ),
    }
    header = TruthHeader(
        body_hash=body.content_hash,
        experiment="",
        seed=0,
        colliders=("ball",),
        planned_contacts=len(contacts),
        made_from={},
    )
    with create_truth(path, header, body) as truth:
        for table, (length, given) in values.items():
            blank = {
                name: np.full((length, *column.row_shape(sizes)), "" if column.dtype == "str" else 0)
                for name, column in TABLES[table].items()
            }
            truth.append(table, {**blank, **given})
    return path


@pytest.fixture
def truth(truth_path: Path, jelly2d_body: ReducedBody):
    with load_truth(truth_path, jelly2d_body) as data:
        yield data


def force_task(truth: TruthData, body: ReducedBody, mechanics, edge_weight: float = 0.3) -> ForceTask:
    split = split_by_state(truth, "ball", 1)
    metric = ForceMetric(body, mechanics, edge_weight)
    data = [
        read_force_data(truth, body, BALL, mechanics, OPTIONS, metric, part)
        for part in (split.train, split.validation)
    ]
    return ForceTask.of(OPTIONS, metric, data[0], data[1], body.n_rows)


def thesis5_task(truth: TruthData, body: ReducedBody, gains: InputGains | None = None) -> ContactCentricTask:
    split = split_by_state(truth, "ball", 1)
    rng = np.random.default_rng(0)
    training = load_dataset(truth, body, BALL, split.train, PoolSize(4, 16, 4), rng)
    validation = load_dataset(truth, body, BALL, split.validation, None, rng)
    return ContactCentricTask(FIELD, training, validation, 0.3, gains or InputGains(1.0, 3.0))


def thesis6_task(truth: TruthData, body: ReducedBody) -> DescriptorTask:
    split = split_by_state(truth, "ball", 1)
    drawing = Drawing(48, 2, np.random.default_rng(0))
    # As of several colliders: in two parts, one of them empty.
    parts = [
        load_descriptor_data(truth, body, BALL, DESCRIPTOR, samples, drawing)
        for samples in (split.train, split.train[:0])
    ]
    training = join_descriptor_data(parts)
    validation = load_descriptor_data(truth, body, BALL, DESCRIPTOR, split.validation, None)
    return DescriptorTask(DESCRIPTOR, DescriptorLoss(1.0, 3.0), training, validation)


def test_split_holds_out_states_and_counts_what_is_left_out(truth):
    split = split_by_state(truth, "ball", 1)
    assert set(truth.sample_state[split.train]) == {0, 1}
    assert set(truth.sample_state[split.validation]) == {2}
    assert split.left_out == 2
    assert not {3, 11} & {*split.train.tolist(), *split.validation.tolist()}
    few = split_by_state(truth, "ball", STATES)  # holding out all would leave none to learn from
    assert set(truth.sample_state[few.train]) == {0, 1, 2}
    assert not len(few.validation)
    with pytest.raises(SoftprintError, match="no samples of collider 'cube'"):
        split_by_state(truth, "cube", 1)


def test_force_metric_is_the_error_of_the_field(truth, jelly2d_body, mechanics):
    """phi^T Gamma phi - 2 phi^T h + c against the fields themselves, at random forces on contact nodes, and around
    anchors."""
    body, edge_weight = jelly2d_body, 0.7
    metric = ForceMetric(body, mechanics, edge_weight)
    rng = np.random.default_rng(1)
    nodes, anchors = np.array([3, 7, 8]), np.array([1, 4])
    loads = np.concatenate([nodes, len(mechanics.compliance.nodes) + anchors])
    phi, w = rng.standard_normal((5, 2)), 1e-3 * rng.standard_normal((body.n_nodes, 2))
    h, c, volume_h, volume_c = metric.of_field(w, loads)
    columns = np.concatenate([mechanics.compliance.dense()[nodes], mechanics.spread.operator[anchors]])
    missed = np.einsum("lanb,la->nb", columns, phi) - w
    volumes, edges = body.mesh.node_volumes, body.mesh.surface_edges
    volume_error = float(volumes @ (missed**2).sum(1) / volumes.sum())
    edge_error = float(((missed[edges[:, 0]] - missed[edges[:, 1]]) ** 2).sum() / len(edges))
    for gamma, linear, constant, expected in (
        (metric.volume_gamma, volume_h, volume_c, volume_error),
        (metric.gamma, h, c, volume_error + edge_weight * edge_error),
    ):
        block = gamma[loads][:, loads].double().numpy()
        value = np.einsum("xi,xyij,yj->", phi, block, phi) - 2.0 * (phi * linear).sum() + constant
        assert value == pytest.approx(expected, rel=1e-5)  # Gamma is float32


@pytest.mark.parametrize("points", [0, 1, 2], ids=["at nodes", "on facets", "two along a facet"])
def test_error_of_forces_on_contact_points_is_that_of_their_field(truth, jelly2d_body, mechanics, points):
    """Of forces on the points and spread around them, that a network with any weights has."""
    body, options = (
        jelly2d_body,
        replace(OPTIONS, refinement=min(points, 1), reduced_refinement=max(points, 1)),
    )
    samples = split_by_state(truth, "ball", 1).validation
    metric = ForceMetric(body, mechanics, 0.3)
    data = read_force_data(truth, body, BALL, mechanics, options, metric, samples)
    task = ForceTask.of(options, metric, data, data, body.n_rows)
    model = task.fresh_model(0)
    with torch.no_grad():
        torch.manual_seed(4)
        model.network.head.weight.copy_(0.1 * torch.randn_like(model.network.head.weight))
    static = StaticCorrection(ForceCorrection("mechanics", model, body, BALL, mechanics), body)
    missed = whole = 0.0
    for sample in samples:
        rows = truth.states["rows"][truth.sample_state[sample]]
        to_rest = np.linalg.inv(rows.T @ body.node_points().basis_gradient)
        expected = to_rest @ truth.displacement(sample)[..., None].astype(np.float64)
        found = to_rest @ static.displacement_along(rows, truth.approach_path(sample))[..., None]
        volumes = body.mesh.node_volumes[:, None, None]
        missed += (volumes * (found - expected) ** 2).sum()
        whole += (volumes * expected**2).sum()
    linear = ForceTask.of(options, metric, data, data, body.n_rows).fresh_model(0)
    assert abs(task.held_out_error(model).rms - task.held_out_error(linear).rms) > 0.01  # it says something
    # Gamma is float32.
    assert task.held_out_error(model).rms == pytest.approx(np.sqrt(missed / whole), rel=1e-3)


@pytest.mark.parametrize("made", [np.array, torch.tensor], ids=["numpy", "torch"])
def test_a_sample_that_hardly_touches_is_not_the_worst_case(made):
    """Of four contacts one is displaced a millionth as much as the others: any error is large beside that."""
    whole, missed = made([4.0, 1.0, 1.0, 1e-12]), made([0.04, 0.09, -1e-20, 1.0])
    found = HeldOutError.of(missed, whole)
    assert found.rms == pytest.approx(np.sqrt(1.13 / 6.0), rel=1e-6)  # single precision of a tensor
    assert found.worst == pytest.approx(0.3, rel=1e-6)
    assert found.samples == 4
    assert np.isnan(HeldOutError.of(made([]), made([])).rms)


def test_quadratic_form_and_its_derivative():
    """Compared with the full Gamma, for samples with different numbers of nodes, in double precision."""
    rng = torch.Generator().manual_seed(2)
    root = torch.randn(18, 18, generator=rng, dtype=torch.float64)
    whole = root @ root.T
    gamma = whole.view(9, 2, 9, 2).permute(0, 2, 1, 3).contiguous()
    nodes = torch.tensor([[3, 1, 8, 0], [5, 2, 0, 0]])
    count = torch.tensor([4, 2])
    phi = torch.randn(2, 4, 2, generator=rng, dtype=torch.float64)
    phi[1, 2:] = 0.0
    phi.requires_grad_()
    blocks = SampleBlocks(gamma, nodes, count)
    found = quadratic_form((blocks[k] for k in range(2)), phi)
    # Kept blocks are those that were gathered.
    assert torch.equal(quadratic_form((blocks[k] for k in range(2)), phi), found)
    derivative = torch.autograd.grad(found.sum(), phi)[0]
    for k, m in enumerate(count):
        full = torch.zeros(9, 2, dtype=torch.float64)
        full[nodes[k, :m]] = phi[k, :m].detach()
        assert float(found[k].detach()) == pytest.approx(
            float(full.view(-1) @ whole @ full.view(-1)), rel=1e-12
        )
        expected = 2.0 * (whole @ full.view(-1)).view(9, 2)[nodes[k, :m]]
        torch.testing.assert_close(derivative[k, :m], expected, rtol=1e-12, atol=0.0)
        assert not derivative[k, m:].any()


def test_training_sets_the_range_of_confidence(truth, jelly2d_body, mechanics):
    """Distance of 95 and correction of 99 in 100 held-out samples: most of them are taken nearly as they are, though
    there are fewer training samples than measures."""
    task = force_task(truth, jelly2d_body, mechanics)
    model = train(task, TrainingSettings(60, 8, 3e-3, 0.0, 2, 0)).model
    split = split_by_state(truth, "ball", 1)
    metric = ForceMetric(jelly2d_body, mechanics, 0.3)
    data = read_force_data(truth, jelly2d_body, BALL, mechanics, OPTIONS, metric, split.validation)
    z, depth = model.normalised(data.local), model.normalised_depth(data.depth)
    with torch.no_grad():
        correction = model.correction(data.local, data.depth, data.force, data.lever)
        ratio = (correction.square().sum((1, 2)) / data.force.square().sum((1, 2))).sqrt()
        assert float(model.confidence.ceiling) == pytest.approx(
            1.5 * float(torch.quantile(ratio, 0.99)), rel=1e-4
        )
        distance = model.confidence.distance(contact_measures(z, depth, data.force))
        assert float(model.confidence.farthest) == pytest.approx(
            float(torch.quantile(distance, 0.95)), rel=1e-4
        )
        confidence = model.confidence(z, depth, data.force, correction)
    assert float(confidence.median()) > 0.8


def test_shallow_contacts_have_weight_in_the_loss_of_force_models(truth, jelly2d_body, mechanics):
    """For a model that returns zero, a sample's loss is c / (c + <c> / 10) up to a common factor: one half for a tenth
    of the mean squared displacement, where without the weights it would be a tenth."""
    task = force_task(truth, jelly2d_body, mechanics)
    split = split_by_state(truth, "ball", 1)
    metric = ForceMetric(jelly2d_body, mechanics, 0.3)
    data = read_force_data(truth, jelly2d_body, BALL, mechanics, OPTIONS, metric, split.train)
    c = data.squared.double()
    expected = c / (c + 0.1 * c.mean())

    nothing = SimpleNamespace(correction=lambda _local, _depth, force, _lever: pad(-force, (0, 2)))
    losses = torch.stack([task.loss(nothing, torch.tensor([k])) for k in range(len(data))]).double()
    # Sums over samples are taken in single precision.
    torch.testing.assert_close(losses, expected / expected.mean(), rtol=1e-5, atol=0.0)
    assert float(expected.max() / expected.min()) < 0.5 * float(c.max() / c.min())


def test_pools_estimate_the_loss_of_all_samples(truth, jelly2d_body):
    """Importance sampling: weighted means over many pools are those over samples, volume and edges. 20,000 nodes and
    edges per sample, drawn where the field is large: 3 %."""
    body, samples = jelly2d_body, np.array([0, 1, 2])
    size, rng = PoolSize(50, 400, 400), np.random.default_rng(2)
    pools = load_dataset(truth, body, BALL, samples, size, rng)
    whole = load_dataset(truth, body, BALL, samples, None, rng)
    drawn, full = pools.batch(torch.arange(len(pools))), whole.batch(torch.arange(len(samples)))
    exact = (full.node_weight * full.target.square().sum(-1)).mean()
    at_nodes, first, second = drawn.target.split([400, 400, 400], dim=1)
    estimate = (drawn.node_weight * at_nodes.square().sum(-1)).mean()
    assert float(estimate) == pytest.approx(float(exact), rel=0.03)
    assert float(drawn.node_weight.mean()) == pytest.approx(float(full.node_weight.mean()), rel=0.03)
    edges = torch.from_numpy(body.mesh.surface_edges)
    exact = (full.target[:, edges[:, 0]] - full.target[:, edges[:, 1]]).square().sum(-1).mean()
    estimate = (drawn.edge_weight * (first - second).square().sum(-1)).mean()
    assert float(estimate) == pytest.approx(float(exact), rel=0.03)


def test_larger_displacements_have_more_pools(truth, jelly2d_body):
    """The requested number on average, and at least one for every sample."""
    samples, rng = np.arange(3), np.random.default_rng(3)
    data = load_dataset(truth, jelly2d_body, BALL, samples, PoolSize(40, 8, 2), rng)
    count = torch.bincount(data.pools.contact)
    assert len(data) == pytest.approx(3 * 40, abs=3)
    whole = load_dataset(truth, jelly2d_body, BALL, samples, None, rng)
    size = (whole.pools.node_weight * whole.pools.target.square().sum(-1)).mean(1).sqrt()
    assert torch.equal(count.argsort(), size.argsort())
    assert int(count.min()) > 0


def test_input_gains_scale_the_first_layer(truth, jelly2d_body):
    """The position by both gains, the other inputs by one; nothing else changes."""
    plain, steep = (
        thesis5_task(truth, jelly2d_body, gains).fresh_model(3).state_dict()
        for gains in (InputGains(1.0, 1.0), InputGains(3.0, 8.0))
    )
    for name, weights in plain.items():
        expected = weights.clone()
        if name.startswith("network.local"):
            expected *= 3.0
        if name == "network.local.weight":
            expected[:, :2] *= 8.0
        assert torch.equal(steep[name], expected), name


def test_contact_forces_are_read_the_same_by_several_workers(truth, jelly2d_body, mechanics, monkeypatch):
    """In the order of one process, collider by collider, of which the second has the even contacts."""
    other = Sphere(0.019, 2, name="other")
    metric = ForceMetric(jelly2d_body, mechanics, 0.3)
    for name, found in (("mechanics", mechanics), ("metric", metric), ("internal_below", None)):
        monkeypatch.setattr(entry, name, lambda *_, found=found: found)
    truth.contacts["collider"][:] = np.arange(STATES * CONTACTS) % 2

    def by_collider(samples):
        number = truth.contacts["collider"][truth.samples["contact"][samples]]
        for collider, shape in enumerate((BALL, other)):
            yield shape, samples[number == collider]

    data = SimpleNamespace(truth=truth, body=jelly2d_body, by_collider=by_collider)
    data.build_colliders, samples = lambda samples: None, np.arange(40)
    read, counted = {}, []
    for count in (1, 3):
        monkeypatch.setattr(entry, "workers_for", lambda *_, count=count: count)
        read[count] = entry.force_data(data, None, OPTIONS, samples, counted.append)
    assert sum(counted) == 2 * len(samples)
    assert read[1].sample.tolist() == [*samples[samples // 2 % 2 == 0], *samples[samples // 2 % 2 == 1]]
    for name in ForceData.__dataclass_fields__:
        one, several = (getattr(read[count], name) for count in (1, 3))
        # float32, of sums that BLAS may order otherwise on one thread.
        torch.testing.assert_close(several, one, rtol=1e-4, atol=1e-7 * float(one.abs().max()), msg=name)


def test_forces_are_learned(truth, jelly2d_body, mechanics):
    """The teacher is a force model: the error on held-out states falls from that of plain elasticity to a few
    per cent."""
    task = force_task(truth, jelly2d_body, mechanics)
    before = task.held_out_error(task.fresh_model(0)).rms
    result = train(task, TrainingSettings(400, 8, 1e-2, 0.0, 4, 0))
    assert before > 0.15
    assert result.history[-1]["validation_rms"] < 0.03
    # Confidence takes the one or two of 15 that are least like training back to mechanics.
    assert result.held_out.rms < before * np.sqrt(2 / 15)
    assert [entry["step"] for entry in result.history] == [100, 200, 300, 400]


def crossed_task(truth, body, mechanics, spoilt: bool = False) -> CrossedForceTask:
    """On all samples; spoilt: with labels of other samples, of which nothing can be learned."""
    metric = ForceMetric(body, mechanics, 0.3)
    samples = split_by_state(truth, "ball", 1).whole
    data = read_force_data(truth, body, BALL, mechanics, OPTIONS, metric, samples)
    if spoilt:
        # What linear mechanics misses, with random signs: errors and displacements are as large as before.
        sign = torch.from_numpy(np.random.default_rng(0).choice([-1.0, 1.0], len(data))).float()
        data = with_missed(data, metric, sign)
    return CrossedForceTask(OPTIONS, metric, data, folds_of(truth, samples, 0), body.n_rows)


def with_missed(data: ForceData, metric: ForceMetric, sign: torch.Tensor) -> ForceData:
    """w_0 + sign (w - w_0) in place of the displacement w, with w_0 that of linear mechanics. In `loss.py`, with a = M
    w_0 at the contact points: h' = a + sign (h - a), and c' from the same by the product rule."""
    changed = {}
    for prefix, gamma in (("", metric.gamma), ("volume_", metric.volume_gamma)):
        h, c = getattr(data, f"{prefix}h"), getattr(data, f"{prefix}squared")
        blocks = SampleBlocks(gamma, data.loads, data.n_loads)
        force = pad(data.force * data.present[..., None], (0, 2))
        places = data.corners, data.shares, data.anchors, data.anchor_shares
        loads = on_loads(force, *places, data.loads.shape[1])
        product = torch.zeros_like(loads)
        for k, count in enumerate(data.n_loads.tolist()):
            product[k, :count] = (blocks[k] @ loads[k, :count].flatten()).view(count, -1)
        around = shared_by(product, data.anchors, data.anchor_shares)
        a = torch.cat([shared_by(at, data.corners, data.shares) for at in (product, around)], dim=2)
        own = (loads * product).sum((1, 2))
        missed = c - 2.0 * (force * h).sum((1, 2)) + own
        cross = (force * (h - a)).sum((1, 2))
        changed[f"{prefix}h"] = (a + sign[:, None, None] * (h - a)) * data.present[..., None]
        changed[f"{prefix}squared"] = own + 2.0 * sign * cross + missed
    return replace(data, **changed)


def shared_by(at: torch.Tensor, places: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
    """sum_c shares_c at[places_c] (s, m, dim) of values (s, n, dim)."""
    return (shares[..., None] * torch.take_along_dim(at[:, None], places[..., None], 2)).sum(2)


def test_all_is_kept_of_what_was_learned_well(truth, jelly2d_body, mechanics):
    """The weights are those of the network on all samples, and its error that of the networks of the folds."""
    task = crossed_task(truth, jelly2d_body, mechanics)
    settings = TrainingSettings(400, 8, 1e-2, 0.0, 4, 0)
    before = untrained(task, 0).held_out
    result = train_crossed(task, lambda _part, one, _share: train(one, settings, select=False))
    alone = train(crossed_task(truth, jelly2d_body, mechanics).whole, settings, select=False).model
    assert before.rms > 0.15
    assert result.held_out.rms < 0.06
    assert result.held_out.samples == before.samples == task.whole.n_samples
    assert task.notes["kept"]["part"] > 0.95
    torch.testing.assert_close(
        result.model.network.head.weight, task.notes["kept"]["part"] * alone.network.head.weight
    )
    # Its own corrections in training are taken as they are, also where those of the folds are smaller.
    ceilings = (float(own.confidence.ceiling) for own in (result.model, alone))
    assert next(ceilings) >= 0.999 * task.notes["kept"]["part"] * next(ceilings)
    assert [entry["step"] for entry in result.history] == [100, 200, 300, 400]


def test_a_network_that_learned_noise_is_taken_back_to_mechanics(truth, jelly2d_body, mechanics):
    """As it is, it would add to the error; what is kept does not."""
    task = crossed_task(truth, jelly2d_body, mechanics, spoilt=True)
    settings = TrainingSettings(400, 8, 1e-2, 0.0, 4, 0)
    before = untrained(task, 0).held_out.rms
    raw = [fold.held_out_error(train(fold, settings, select=False).model).rms for fold in task.folds]
    result = train_crossed(task, lambda _part, one, _share: train(one, settings, select=False))
    assert np.mean(raw) > 1.05 * before
    assert task.notes["kept"]["part"] < 0.1
    assert result.held_out.rms < 1.005 * before


def test_trained_forces_have_the_same_error_at_run_time(truth, jelly2d_body, mechanics):
    """The error in the metric of training is that of the correction itself, up to the stretch of F."""
    task = force_task(truth, jelly2d_body, mechanics)
    model = task.fresh_model(0)
    correction = StaticCorrection(ForceCorrection("x", model, jelly2d_body, BALL, mechanics), jelly2d_body)
    missed = whole = 0.0
    volumes = jelly2d_body.mesh.node_volumes
    for sample in split_by_state(truth, "ball", 1).validation:
        u = truth.displacement(int(sample))
        rows = truth.states["rows"][truth.sample_state[sample]]
        found = correction.displacement_along(rows, truth.approach_path(int(sample)))
        missed += volumes @ ((found - u) ** 2).sum(1)
        whole += volumes @ (u**2).sum(1)
    # States stretch the block by a few per cent.
    assert task.held_out_error(model).rms == pytest.approx(np.sqrt(missed / whole), rel=0.1)


def test_fields_are_learned(truth, jelly2d_body):
    """Thirty samples do not teach a field network other states, but it must be able to fit them."""
    task = thesis5_task(truth, jelly2d_body)
    everything = torch.arange(task.n_samples)
    before = float(task.loss(task.fresh_model(0), everything).detach())
    settings = TrainingSettings(1000, 8, 5e-3, 0.0, 1, 0)
    after = float(task.loss(train(task, settings).model, everything).detach())
    assert after < 0.25 * before


def test_descriptors_are_learned(truth, jelly2d_body):
    """As for fields: it must be able to fit its training data."""
    task = thesis6_task(truth, jelly2d_body)
    everything = torch.arange(task.n_samples)
    before = float(task.loss(task.fresh_model(0), everything).detach())
    after = float(
        task.loss(train(task, TrainingSettings(600, 256, 6e-3, 0.0, 1, 0)).model, everything).detach()
    )
    assert after < 0.25 * before


def test_trained_descriptors_have_the_same_error_at_run_time(truth, jelly2d_body):
    """The error in training is that of the correction itself over the volume, including nodes beyond d."""
    body, task = jelly2d_body, thesis6_task(truth, jelly2d_body)
    model = train(task, TrainingSettings(50, 256, 6e-3, 0.0, 1, 0)).model
    geometry = DirectGeometry(BALL, DESCRIPTOR.radius, DESCRIPTOR.sets)
    bound = DescriptorCorrection("x", model, body, BALL, geometry).bind(body.node_points())
    missed = whole = 0.0
    volumes = body.mesh.node_volumes
    for sample in split_by_state(truth, "ball", 1).validation:
        u = truth.displacement(int(sample))
        found = bound.displacement(truth.states["rows"][truth.sample_state[sample]], truth.pose(int(sample)))
        missed += volumes @ ((found - u) ** 2).sum(1)
        whole += volumes @ (u**2).sum(1)
    # Training data are float32.
    assert task.held_out_error(model).rms == pytest.approx(np.sqrt(missed / whole), rel=1e-4)


def test_points_of_interest_give_unbiased_sums_over_all_nodes(truth, jelly2d_body):
    """Drawn with weights, they give the sum over all nodes times the density of the thesis."""
    body, sample = jelly2d_body, split_by_state(truth, "ball", 1).train[-1:]
    drawing = Drawing(20_000, 1, np.random.default_rng(0))
    drawn = load_descriptor_data(truth, body, BALL, DESCRIPTOR, sample, drawing)
    everywhere = load_descriptor_data(truth, body, BALL, DESCRIPTOR, sample, None)
    distance = everywhere.descriptor[:, 0, 0].double().numpy()  # the first of a descriptor is its centre
    u = everywhere.target.double().numpy() * attenuation(distance, DESCRIPTOR.radius)[:, None]
    density = np.exp(-0.5 * (np.maximum(distance, 0.0) / DESCRIPTOR.radius) ** 2)
    exact = (everywhere.weight.double().numpy() * density) @ (u**2).sum(axis=1)
    estimated = float((drawn.weight * drawn.target.square().sum(1)).double().sum())
    # 20,000 points drawn by the size of u leave about a hundredth of the spread of |u| w.
    assert estimated == pytest.approx(exact, rel=0.03)


@pytest.mark.parametrize("form", ["force", "thesis5"])
def test_resumed_equals_uninterrupted(form, truth, jelly2d_body, mechanics, tmp_path):
    def task():
        return (
            force_task(truth, jelly2d_body, mechanics)
            if form == "force"
            else thesis5_task(truth, jelly2d_body)
        )

    settings = TrainingSettings(20, 4, 5e-3, 1e-3, 4, 7)
    straight = train(task(), settings)
    again = train(task(), settings)

    class Killed(Exception):
        pass

    def kill(steps: int, _note: str) -> None:
        kill.done += steps
        if kill.done == 13:
            raise Killed

    kill.done = 0
    path = tmp_path / "run.checkpoint"
    with pytest.raises(Killed):
        train(task(), settings, path, progress=kill)
    assert load_checkpoint(path).step == 10
    resumed = train(task(), settings, path)
    for name, weights in straight.model.state_dict().items():
        assert torch.equal(weights, again.model.state_dict()[name]), name
        assert torch.equal(weights, resumed.model.state_dict()[name]), name
    assert [entry["step"] for entry in resumed.history] == [5, 10, 15, 20]
    # A checkpoint of another run is ignored: this one starts from the beginning.
    other = train(task(), TrainingSettings(4, 4, 5e-3, 1e-3, 1, 7), path)
    assert [entry["step"] for entry in other.history] == [4]


def test_checkpoints_of_other_models_are_not_removed(tmp_path):
    """Also of those whose names begin with the same word."""
    mine, other = (Checkpoints(tmp_path / f"{name}.safetensors") for name in ("ours", "ours.v2"))
    for part in ("", "part 1 of 4", "all samples"):
        mine.path(part).touch()
        other.path(part).touch()
    kept = {other.path(part) for part in ("", "part 1 of 4", "all samples")}
    mine.remove()
    assert set(tmp_path.iterdir()) == kept


def test_a_training_that_diverges_is_an_error(truth, jelly2d_body):
    """Not a correction of the weights that it began with, or of none."""
    task = thesis5_task(truth, jelly2d_body)
    settings = TrainingSettings(4, 8, 1e30, 0.0, 4, 0)
    with pytest.raises(SoftprintError, match=r"has diverged: at step \d the loss is .*smaller learning_rate"):
        train(task, settings)


def test_damaged_checkpoints_are_refused(tmp_path):
    path = tmp_path / "x.checkpoint"
    save_checkpoint(path, Checkpoint("run", 3, [{"step": 3.0}], {"model.w": torch.ones(2)}))
    assert load_checkpoint(path).history == [{"step": 3.0}]
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(SoftprintError, match="training checkpoint file is damaged"):
        load_checkpoint(path)


def test_no_altered_byte_of_a_checkpoint_goes_unnoticed(tmp_path):
    path = tmp_path / "x.checkpoint"
    tensors = {"model.w": torch.arange(3.0), "adam.0.step": torch.tensor(3.0)}
    save_checkpoint(path, Checkpoint("run", 3, [{"step": 3.0}], tensors))
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << (place % 8)
        path.write_bytes(damaged)
        with pytest.raises(SoftprintError, match=r"x\.checkpoint: .*remove it and train again"):
            load_checkpoint(path)


def test_truth_of_another_body_is_refused(truth_path, jelly3d_body):
    with pytest.raises(SoftprintError, match="another body"):
        load_truth(truth_path, jelly3d_body)
