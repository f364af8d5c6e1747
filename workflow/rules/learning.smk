rule split:
    "Divides the figures into training, validation and test."
    input:
        packed=PACKED,
        record=f"{DATA}/figures.json",
    output:
        update(SPLIT),
    log:
        f"{OUT}/log/split.log",
    localrule: True
    params:
        split={key: value for key, value in SETTINGS["split"].items() if key != "least"},
    script:
        "../scripts/split.py"


rule train:
    "Trains one network, or resumes its training."
    input:
        packed=PACKED,
        lights=LIGHTS,
        split=SPLIT,
        start=lambda wildcards: PLAN.start(wildcards.training),
    output:
        network=update(f"{OUT}/train/{{training}}.safetensors"),
        curve=update(f"{OUT}/train/{{training}}.csv"),
    log:
        f"{OUT}/log/train/{{training}}.log",
    resources:
        mem_mb=memory,
        runtime=lambda wildcards, attempt: 1440 * attempt,
        gpu=PLAN.gpus,
        device=lambda wildcards: PLAN.device(wildcards.training),
    params:
        settings=lambda wildcards: PLAN.settings(wildcards.training),
    script:
        "../scripts/train.py"


rule evaluate:
    "Scores a network, or baselines such as the mean of the training set, on every test figure under every test light."
    input:
        packed=PACKED,
        lights=LIGHTS,
        split=SPLIT,
        network=lambda wildcards: (
            [PLAN.network(wildcards.training)]
            if wildcards.training in PLAN.trainings
            else []
        ),
    output:
        update(f"{OUT}/evaluate/{{on}}{{training}}.csv"),
    log:
        f"{OUT}/log/evaluate/{{on}}{{training}}.log",
    resources:
        mem_mb=memory,
        runtime=minutes,
        gpu=lambda wildcards: PLAN.gpus * (wildcards.training in PLAN.trainings),
    params:
        color=SETTINGS["train"]["color"],
        order=SETTINGS["bake"]["order"],
        scored=SCORED,
    script:
        "../scripts/evaluate.py"
