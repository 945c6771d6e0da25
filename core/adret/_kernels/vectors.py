"""What loops over single cells are never compiled to: shuffles between vectors, written by hand.

On processors without such vectors the compiler takes them apart; results are the same.
"""

from adret._kernels.jit import array_parts, intrinsic, ir, types

I32 = ir.IntType(32)
F32 = ir.FloatType()
FUSED = ("contract",)


def _pick(builder, a, b, lanes):
    order = ir.Constant(ir.VectorType(I32, len(lanes)), list(lanes))
    return builder.shuffle_vector(a, b, order)


def _spread(builder, value, count):
    """A vector of `count` equal numbers."""
    nothing = ir.Constant(ir.VectorType(F32, count), ir.Undefined)
    return _pick(builder, builder.insert_element(nothing, value, I32(0)), nothing, [0] * count)


def _vector(builder, pointer, count):
    return builder.bitcast(pointer, ir.VectorType(F32, count).as_pointer())


@intrinsic
def four_lookups(typingctx, table, place, share, factor, at, planes, plane):
    """Look four cells up in a table of three pairs (b, a), and write b - factor·a of each.

    Row r of the flat `table` is 8 numbers from r·8 on: three b, one unused, three a, one unused. Of
    cell x = at … at + 3, both are linear between the row that starts at ``place[x]`` and the next
    one, by ``share[x]``. The results go to ``planes[x]``, ``planes[plane + x]`` and
    ``planes[2 plane + x]``. A row is one vector; four cells are turned by shuffles.
    """

    def codegen(context, builder, signature, args):
        start, width = args[4], args[4].type
        kinds = signature.args
        rows, places, shares, factors = (
            array_parts(context, builder, kinds[k], args[k]).data for k in range(4)
        )
        target = array_parts(context, builder, kinds[5], args[5]).data
        found = []
        for cell in range(4):
            x = builder.add(start, width(cell))
            row, part, lean = (
                builder.load(builder.gep(head, [x])) for head in (places, shares, factors)
            )
            here = builder.gep(rows, [builder.zext(row, width)])
            below = builder.load(_vector(builder, here, 8), align=4)
            above = builder.load(_vector(builder, builder.gep(here, [width(8)]), 8), align=4)
            rise = builder.fsub(above, below)
            rise = builder.fmul(_spread(builder, part, 8), rise, flags=FUSED)
            both = builder.fadd(below, rise, flags=FUSED)
            a = _pick(builder, both, both, (4, 5, 6, 7))
            a = builder.fmul(_spread(builder, lean, 4), a, flags=FUSED)
            b = _pick(builder, both, both, (0, 1, 2, 3))
            found.append(builder.fsub(b, a, flags=FUSED))
        first = [_pick(builder, *found[k : k + 2], (0, 4, 1, 5)) for k in (0, 2)]
        third = [_pick(builder, *found[k : k + 2], (2, 6, 3, 7)) for k in (0, 2)]
        turned = (
            _pick(builder, *first, (0, 1, 4, 5)),
            _pick(builder, *first, (2, 3, 6, 7)),
            _pick(builder, *third, (0, 1, 4, 5)),
        )
        for k, four in enumerate(turned):
            x = builder.add(start, builder.mul(args[6], width(k)))
            builder.store(four, _vector(builder, builder.gep(target, [x]), 4), align=4)
        return context.get_dummy_value()

    return types.void(table, place, share, factor, at, planes, plane), codegen


@intrinsic
def turn_eight(typingctx, source, row, row_step, column, target, i, i_step, j):
    """Write 8 x 8 cells of `source` transposed: rows become columns.

    ``target[i + b·i_step, j + a] = source[row + a·row_step, column + b]`` for a, b = 0 … 7.
    Both are float32 whose cells lie side by side in a row; rows may have gaps between them.
    """
    if source.dtype != types.float32 or target.dtype != types.float32:
        return None

    def codegen(context, builder, signature, args):
        kinds = signature.args
        i64, byte = ir.IntType(64), ir.IntType(8).as_pointer()

        def cells(array, kind, first, step, across, count):
            """Pointer to eight cells of row `first` + `count`·`step`, from `across` on."""
            parts = array_parts(context, builder, kind, array)
            down = builder.add(first, builder.mul(step, i64(count)))
            skip = builder.mul(down, builder.extract_value(parts.strides, 0))
            skip = builder.add(skip, builder.mul(across, i64(4)))
            place = builder.gep(builder.bitcast(parts.data, byte), [skip])
            return _vector(builder, place, 8)

        def both(a, b, low):
            high = [lane + 2 for lane in low]
            return _pick(builder, a, b, low), _pick(builder, a, b, high)

        given = [
            builder.load(cells(args[0], kinds[0], args[1], args[2], args[3], a), align=4)
            for a in range(8)
        ]
        # Pairs of rows interleaved, then pairs of pairs, then halves exchanged.
        pairs = [both(given[a], given[a + 1], [0, 8, 1, 9, 4, 12, 5, 13]) for a in (0, 2, 4, 6)]
        fours = [
            both(pairs[a][side], pairs[a + 1][side], [0, 1, 8, 9, 4, 5, 12, 13])
            for a in (0, 2)
            for side in (0, 1)
        ]
        upper, lower = [*fours[0], *fours[1]], [*fours[2], *fours[3]]
        turned = [
            _pick(builder, upper[b % 4], lower[b % 4], lanes)
            for b in range(8)
            for lanes in [(0, 1, 2, 3, 8, 9, 10, 11) if b < 4 else (4, 5, 6, 7, 12, 13, 14, 15)]
        ]
        for b, eight in enumerate(turned):
            there = cells(args[4], kinds[4], args[5], args[6], args[7], b)
            builder.store(eight, there, align=4)
        return context.get_dummy_value()

    given = (source, row, row_step, column, target, i, i_step, j)
    return types.void(*given), codegen
