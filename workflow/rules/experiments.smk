# Experiments that are not tables of trainings. Their rows are the networks that they use.
TEST_SPLIT = f"{OUT}/split/{SETTINGS['split']['kind']}.json"


rule light_transfer:
    "Lights each person by the light that is inferred of another."
    input:
        networks=PLAN.networks("light_transfer").values(),
        packed=PACKED,
        split=TEST_SPLIT,
        lights=LIGHTS,
    output:
        scores=f"{OUT}/light_transfer/scores.csv",
        plate=f"{OUT}/light_transfer/plate.png",
    log:
        f"{OUT}/log/light_transfer.log",
    benchmark:
        f"{OUT}/benchmark/light_transfer/all.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    params:
        trainings=list(PLAN.networks("light_transfer")),
        rows=PLAN.first_trainings("light_transfer"),
        code=code_hash("light_transfer"),
    script:
        "../scripts/light_transfer.py"


rule trace:
    "Renders test figures by path tracing."
    input:
        packed=PACKED,
        split=TEST_SPLIT,
        lights=LIGHTS,
        meshes=expand(f"{DATA}/aligned/{{batch}}", batch=PLAN.batches),
    output:
        f"{OUT}/path_traced/traced.npz",
    log:
        f"{OUT}/log/trace.log",
    benchmark:
        f"{OUT}/benchmark/trace/all.tsv"
    threads: workflow.cores
    resources:
        mem_mb=8000,
    params:
        trace=SETTINGS["trace"],
        panoramas=SETTINGS["panoramas"],
        order=SETTINGS["bake"]["order"],
        rays=SETTINGS["bake"]["rays"],
        code=code_hash("trace"),
    script:
        "../scripts/trace.py"


rule path_traced:
    "Scores networks on path-traced pictures."
    input:
        networks=PLAN.networks("path_traced").values(),
        packed=PACKED,
        lights=LIGHTS,
        traced=f"{OUT}/path_traced/traced.npz",
    output:
        scores=f"{OUT}/path_traced/scores.csv",
        plate=f"{OUT}/path_traced/plate.png",
    log:
        f"{OUT}/log/path_traced.log",
    benchmark:
        f"{OUT}/benchmark/path_traced/all.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    params:
        trainings=list(PLAN.networks("path_traced")),
        rows=PLAN.first_trainings("path_traced"),
        code=code_hash("path_traced"),
    script:
        "../scripts/path_traced.py"
