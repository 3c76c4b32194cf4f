import sys,collections,math
order=[];by=collections.defaultdict(list)
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0] in 'EP':
        if w[1] not in by: order.append(w[1])
        by[w[1]].append(l)
rows=[]
for k in order:
    ls=by[k];lastt=None;bat=9;t0=0;dur=0;R=None;n=0
    turned=0;prev=None;srch=False;al=0
    for l in ls:
        w=l.split()
        if w[0]=='P':
            true=tuple(map(float,w[3:6]))
            if srch and prev: turned+=(true[2]-prev[2]+math.pi)%(2*math.pi)-math.pi
            prev=true
        elif 'Engine(Dock)' in l and w[3]=='Heard': srch=True;turned=0;R=None
        elif w[3]=='Log' and ' R ' in l: i=w.index('R');R=[float(w[i+j]) for j in (2,4,6,8,10)]
        elif w[3]=='Log' and ' A ' in l: al=math.degrees(float(w[w.index('A')+1]))
        elif w[3]=='Log' and ' B ' in l:
            i=w.index('B');b=tuple(map(float,w[i+1:i+4]))
            if R and lastt: 
                dh=(b[2]-lastb[2])-(true[2]-lastt[2]);dh=math.degrees((dh+math.pi)%(2*math.pi)-math.pi)
                rows.append((math.degrees(turned),R[0]/R[1],R[0]/R[2],R[0],R[1],R[3],dh,al,k[-6:],n))
            n+=1
            srch=False;al=0;lastt,lastb=true,b
rows.sort()
for r in rows: print('turned %.0f at/ref %.2f at/least %.2f at %.4f ref %.4f found %.2f dh %+.0f al %+.0f %s %d'%r)
