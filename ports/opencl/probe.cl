/* The device's part of the probe: four values for each work item, in their place. */
__kernel void probe(__global float *values)
{
    uint i = get_global_id(0);
    float v[4];
    for (int k = 0; k < 4; k++)
        v[k] = values[4 * i + k];
    lull_cl_probe(v);
    for (int k = 0; k < 4; k++)
        values[4 * i + k] = v[k];
}
