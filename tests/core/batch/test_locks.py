"""A batch in a folder on a file system that cannot lock files, such as some network shares."""

import errno

import pytest

from cvdgs.core.batch import local_pool, run_task
from cvdgs.core.batch.task import Kind, Plan, Task
from cvdgs.core.errors import InputError


@pytest.fixture
def without_locks(monkeypatch):
    def refuse(_file):
        raise OSError(errno.ENOLCK, "No locks available")

    for module in (local_pool, run_task):
        monkeypatch.setattr(module, "lock_exclusively", refuse)


@pytest.mark.usefixtures("without_locks")
def test_a_batch_that_cannot_be_locked_is_refused(tmp_path):
    with pytest.raises(InputError, match="No locks available"), local_pool.alone(Plan(tmp_path, ())):
        pass


@pytest.mark.timeout(20)
@pytest.mark.usefixtures("without_locks")
def test_a_task_that_cannot_be_locked_is_refused_instead_of_waiting_for_ever(tmp_path):
    plan = Plan(tmp_path, (Task("page", Kind.PAGE),))
    with pytest.raises(InputError, match="No locks available"):
        run_task.run_task(plan, "page", lambda _: None)
