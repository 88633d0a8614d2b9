"""Lists of a task: none is empty, and their product is no larger than memory."""

import pytest
from pydantic import ValidationError

from haptix.base.errors import InputError, LimitError
from haptix.base.task import Context, all_tasks
from haptix.tasks.surfaces import Query


def lists_of(task):
    """Fields that take a list, and need at least one value."""
    for name, field in task.model_fields.items():
        if str(field.annotation).startswith("tuple[") and field.default != ():
            yield name


LISTS = [(task, name) for task in all_tasks() for name in lists_of(task)]


def test_there_are_lists():
    assert len(LISTS) > 10


@pytest.mark.parametrize(("task", "name"), LISTS, ids=lambda one: getattr(one, "__name__", one))
def test_an_empty_list_is_refused_by_name(task, name):
    with pytest.raises(InputError) as refused:
        task(**{name: []})
    every = refused.value.__context__  # beside others that are missing
    assert isinstance(every, ValidationError)
    assert name in {error["loc"][0] for error in every.errors()}


def test_a_query_for_more_than_memory_holds_is_refused_before_it_is_solved(tmp_path):
    many = tuple(0.1 + 1e-6 * number for number in range(1000))
    with pytest.raises(LimitError, match="1000000"):
        Query(normal_force_n=many, voltage_v=many).run(Context(tmp_path))
