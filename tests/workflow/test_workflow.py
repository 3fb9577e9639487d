import pytest

from knotflow.workflow import WorkflowError


def test_nodes_are_called_like_stages_and_bound_by_name(read, root):
    workflow = read()
    assert [*workflow.nodes] == ["toy_numbers", "toy_sum"]
    assert workflow.nodes["toy_sum"].inputs == {"toy_numbers": "toy_numbers"}
    assert workflow.nodes["toy_numbers"].arguments["seed"] == 1
    assert workflow.results == {"sum.txt": ("toy_sum", "sum.txt")}


def test_layers_of_an_argument(read, root):
    def offset():
        return read().nodes["numbers"].arguments["toy"].offset

    root["workflow"]["stages"] = {
        "numbers": {"stage": "toy_numbers"},
        "toy_sum": {"toy_numbers": "numbers"},
    }
    assert offset() == 0.5  # the root
    root["toy_numbers"]["toy"] = {"offset": 1.5}
    assert offset() == 1.5  # the section of the stage
    root["workflow"]["stages"]["numbers"]["toy"] = {"offset": 2.5}
    assert offset() == 2.5  # the node
    root["workflow"]["stages"]["numbers"]["toy"] = "big"
    assert offset() == 100.0  # an option of the group
    root["numbers"] = {"toy": {"offset": 3.5}}
    assert offset() == 3.5  # the section of the node


def test_the_section_of_the_experiment_is_for_stages_without_their_own(read, root):
    root["toys"] = {"seed": 7, "shards": 5}
    arguments = read().nodes["toy_numbers"].arguments
    assert (arguments["seed"], arguments["shards"]) == (1, 5)


def test_matrix_makes_a_node_a_value_and_matches_shared_axes(read, root):
    root["workflow"] |= {
        "matrix": {"seed": [1, 2], "size": {"small": {}, "large": {"shards": 9}}},
        "stages": {
            "toy_numbers": {"matrix": ["seed", "size"]},
            "toy_sum": {"matrix": ["seed", "size"]},
            "toy_table": {"matrix": ["seed"], "sums": "toy_sum"},
        },
        "results": {"one.csv": "toy_table[1]/table.csv"},
    }
    nodes = read().nodes
    assert nodes["toy_table[1]"].inputs["sums"] == {
        "small": "toy_sum[1.small]",
        "large": "toy_sum[1.large]",
    }
    assert "toy_table[2]" not in nodes  # no result needs it
    assert nodes["toy_sum[1.large]"].inputs == {"toy_numbers": "toy_numbers[1.large]"}
    assert nodes["toy_numbers[1.large]"].arguments == nodes["toy_numbers[1.small]"].arguments | {
        "shards": 9
    }


def test_optional_inputs_are_absent_unless_named(read, root, tmp_path):
    assert "extra" not in read().nodes["toy_sum"].inputs
    root["extra"] = str(tmp_path / "number")
    (tmp_path / "number").write_text("1")
    assert "extra" not in read().nodes["toy_sum"].inputs


def test_a_file_counts_by_its_contents(read, root, tmp_path):
    def key():
        return read().keys["toy_sum"]

    file = tmp_path / "numbers"
    root["workflow"]["stages"] = {"toy_sum": None}
    root["toy_numbers"] = str(file)
    file.write_text("1")
    before = key()
    file.write_text("2")
    assert key() != before
    file.write_text("1")
    assert key() == before


def test_keys_follow_inputs_but_not_captions_and_threads(read, root):
    before = read().keys
    root["workflow"]["stages"]["toy_sum"]["caption"] = "Another"
    root["toy"]["threads"] = 8
    assert read().keys == before
    root["toy"]["offset"] = 0.75
    after = read().keys
    assert all(after[name] != before[name] for name in before)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stages": {"toy_nothing": None}}, "unknown stage 'toy_nothing'"),
        ({"stages": {"toy_sum": {"toy_numbers": "x"}}}, "no node 'x'; nodes are: toy_sum"),
        ({"stages": {"toy_sum": None}}, "input 'toy_numbers' is missing"),
        ({"stages": {"toy_numbers": {"sede": 1}}}, "no parameter 'sede'; it has shards, toy, seed"),
        ({"stages": {"toy_numbers": {"toy": "huge"}}}, "no toy 'huge'; there are big"),
        ({"stages": {"toy_numbers": {"matrix": ["axis"]}}}, "no axis 'axis'"),
        ({"results": {"sum.txt": "x"}}, "no node 'x'"),
        ({"results": {"../sum.txt": "toy_sum"}}, "outside of the results"),
        ({"stage": {}}, "not stage"),
        (
            {
                "stages": {
                    "toy_numbers": {"matrix": ["seed"]},
                    "toy_sum": {"toy_numbers": "toy_numbers"},
                },
                "matrix": {"seed": [1, 2]},
            },
            "name one, toy_numbers",
        ),
        (
            {
                "stages": {
                    "toy_numbers": {"matrix": ["seed"]},
                    "toy_sum": {"toy_numbers": "toy_numbers[3]"},
                },
                "matrix": {"seed": [1, 2]},
            },
            "no node 'toy_numbers[3]'; there are toy_numbers[1], toy_numbers[2]",
        ),
        (
            {
                "matrix": {"size": {"big": {"shrads": 2}}},
                "stages": {"toy_numbers": {"matrix": ["size"]}},
                "results": {},
            },
            "no stage along it takes 'shrads'",
        ),
        (
            {
                "stages": {
                    "toy_numbers": None,
                    "a": {"stage": "toy_sum", "extra": "b"},
                    "b": {"stage": "toy_sum", "extra": "a"},
                },
                "results": {},
            },
            "a cycle",
        ),
    ],
)
def test_mistakes_are_refused_and_name_what_is_valid(read, root, changes, message):
    root["workflow"] |= changes
    with pytest.raises(WorkflowError) as error:
        read()
    assert message in str(error.value)
