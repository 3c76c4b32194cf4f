import sys,collections,math
P=collections.defaultdict(list);ok=bad=0
for l in open(sys.argv[1]):
    w=l.split()
    if not w: continue
    if w[0]=='P': P[w[1]].append(tuple(map(float,w[2:6])))
    elif w[0]=='E' and 'R pressed' in l:
        t=float(w[2]);q=[p for p in P[w[1]] if t-5.5<p[0]<=t]
        mv=sum(math.hypot(b[1]-a[1],b[2]-a[2]) for a,b in zip(q,q[1:]));tr=sum(abs((b[3]-a[3]+math.pi)%(2*math.pi)-math.pi) for a,b in zip(q,q[1:]))
        if mv>.05 or tr>.3: bad+=1;print('FALSE',w[1][-6:],t,'moved %.2f turned %.2f'%(mv,tr))
        else: ok+=1
print('pressed',ok,'false',bad)
